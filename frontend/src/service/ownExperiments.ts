/** What is read of experiments as texts: the text, its versions, a run as one, and what one that is composed comes to. */

import { queryOptions } from "@tanstack/react-query";
import { answered, api } from "../wire/client";

/** The text of an experiment, ready-made or own, and what it says; of a version that is gone there is none. */
export function experimentTextQuery(name: string) {
  return queryOptions({
    queryKey: ["experiment-texts", name],
    queryFn: () => answered(api.GET("/api/experiments/texts/{name}", { params: { path: { name } } })),
  });
}

/** The versions of an own experiment, the newest first. */
export function experimentVersionsQuery(name: string) {
  return queryOptions({
    queryKey: ["experiment-versions", name],
    queryFn: async () =>
      (await answered(api.GET("/api/experiments/own/{name}/versions", { params: { path: { name } } })))
        .experiments,
  });
}

/** A run as an experiment, and what of the run it does not repeat. */
export function experimentAsRunQuery(run_id: number) {
  return queryOptions({
    queryKey: ["experiment-as-run", run_id],
    queryFn: () => answered(api.GET("/api/experiments/as-run/{run_id}", { params: { path: { run_id } } })),
  });
}

/** A text looked over, which takes no time: whether it would be refused, and why. */
export function lookedOverQuery(text: string) {
  return queryOptions({
    queryKey: ["looked-over", text],
    queryFn: () => answered(api.POST("/api/experiments/check", { body: { text, play: false } })),
    retry: false,
    refetchOnWindowFocus: false,
    gcTime: 60_000,
  });
}

/** A text looked over and played dry; asked again while there is no place. */
export function composedPreviewQuery(text: string, tuning: string) {
  return queryOptions({
    queryKey: ["composed-preview", text, tuning],
    queryFn: () => answered(api.POST("/api/experiments/check", { body: { text, play: true } })),
    retry: false,
    refetchOnWindowFocus: false,
    refetchInterval: ({ state }) => (state.data?.busy ? 1500 : false),
    gcTime: 60_000,
  });
}
