/** The recording that is played in place of a plant: what is in it, and what its player is told. */

import { queryOptions, useMutation } from "@tanstack/react-query";
import { answered, api } from "../wire/client";
import type { PlayerOrder } from "../wire/types";

/** What is played does not change as long as the service runs. */
export const playedQuery = queryOptions({
  queryKey: ["player"],
  queryFn: () => answered(api.GET("/api/player")),
  staleTime: Number.POSITIVE_INFINITY,
  retry: false,
});

/** Plays, pauses, sets the speed or goes to a time; what is left out stays as it is. */
export function usePlayer() {
  return useMutation({
    mutationFn: (body: Partial<PlayerOrder>) => answered(api.PUT("/api/player", { body })),
  });
}
