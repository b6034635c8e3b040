/** The session: name, sign-in and sign-out; and whether the service answers. */

import { queryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import { answered, api } from "../../wire/client";
import { giveUpControl, heldEpoch } from "../../wire/control";
import { renameDrafts } from "../forms/draftStorage";

export const sessionQuery = queryOptions({
  queryKey: ["session"],
  queryFn: () => answered(api.GET("/api/session")),
  retry: false,
});

export const healthQuery = queryOptions({
  queryKey: ["health"],
  queryFn: () => answered(api.GET("/api/health")),
});

export function useSignIn() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: { token: string; name: string }) => answered(api.POST("/api/session", { body })),
    onSuccess: () => queries.invalidateQueries(),
  });
}

/** Sets the name of the signed-in person. */
export function useSetName() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (name: string) => answered(api.PUT("/api/session/name", { body: { name } })),
    onSuccess: (session) => {
      const before = queries.getQueryData(sessionQuery.queryKey);
      if (before !== undefined) renameDrafts(before.name, session.name);
      queries.setQueryData(sessionQuery.queryKey, session);
      void queries.invalidateQueries({ queryKey: ["preferences"] });
    },
  });
}

/** Ends this browser's session. Releases the control lease first: otherwise the service would treat the page as lost. */
export function useSignOut() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: async () => {
      if (heldEpoch() !== null) await giveUpControl();
      return answered(api.DELETE("/api/session"));
    },
    onSuccess: () => queries.resetQueries(),
  });
}
