import { queryOptions, useMutation } from "@tanstack/react-query";
import { useEffect, useRef } from "react";
import { answered, api } from "../wire/client";
import type { SettingValues } from "./commands";

/** What is read of experiments as texts: the text, its versions, a run as one, and what one that is composed comes to. */

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

/** A dry run: played beside the service while the connection that asked for it stands. */

/** How far one's own dry run is; asked for while the page shows it. */
export const dryRunProgressQuery = queryOptions({
  queryKey: ["dry-run-progress"],
  queryFn: () => answered(api.GET("/api/experiments/dry-run/progress")),
  refetchInterval: 500,
  gcTime: 0,
});

/** A dry run that can be cancelled; it ends with its connection, also where the page is left. */
export function useDryRun() {
  const connection = useRef<AbortController | null>(null);
  const dryRun = useMutation({
    mutationFn: (body: { name: string; settings: SettingValues }) => {
      connection.current = new AbortController();
      const { signal } = connection.current;
      return answered(api.POST("/api/experiments/dry-run", { body, signal }));
    },
  });
  useEffect(() => () => connection.current?.abort(), []);
  function cancel(): void {
    connection.current?.abort();
    dryRun.reset();
  }
  return { ...dryRun, cancel };
}

/** A pause between two runs of one order. */

/** Lets the next run of the order under way wait, or begin. */
export function usePauseOrder() {
  return useMutation({
    mutationFn: (paused: boolean) => answered(api.PUT("/api/identifications/pause", { body: { paused } })),
  });
}
