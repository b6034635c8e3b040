/** A pause between two runs of one order. */

import { useMutation } from "@tanstack/react-query";
import { answered, api } from "../wire/client";

/** Lets the next run of the order under way wait, or begin. */
export function usePauseOrder() {
  return useMutation({
    mutationFn: (paused: boolean) => answered(api.PUT("/api/identifications/pause", { body: { paused } })),
  });
}
