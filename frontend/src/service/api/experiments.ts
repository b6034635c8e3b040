/** Experiments: kinds, texts and versions, checks, dry runs, starts, and the queue. */

import { queryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import { useEffect, useRef } from "react";
import { answered, api } from "../../wire/client";
import { isRunning, OTHERS_MS, WHILE_RUNNING_MS } from "./polling";

export const experimentKindsQuery = queryOptions({
  queryKey: ["experiment-kinds"],
  queryFn: async () => (await answered(api.GET("/api/experiments"))).experiments,
  staleTime: Number.POSITIVE_INFINITY,
});

export const queueQuery = queryOptions({
  queryKey: ["queue"],
  refetchInterval: OTHERS_MS,
  queryFn: () => answered(api.GET("/api/experiments/queue")),
});

export function experimentQuery(id: number) {
  return queryOptions({
    queryKey: ["experiments", id],
    queryFn: () => answered(api.GET("/api/experiments/{id}", { params: { path: { id } } })),
    refetchInterval: (query) => (isRunning(query.state.data?.status ?? "") ? WHILE_RUNNING_MS : false),
  });
}

type SettingValues = Record<string, boolean | number | string>;

/** Checks an experiment as a start would, and simulates it; the service stores nothing. */
export function useCheckExperiment() {
  return useMutation({
    mutationFn: (text: string) =>
      answered(api.POST("/api/experiments/check", { body: { text, play: true } })),
  });
}

/** Stores an experiment as the next version of its name. */
export function useSaveExperiment() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (text: string) => answered(api.POST("/api/experiments/own", { body: { text } })),
    onSuccess: () =>
      Promise.all(
        ["experiment-kinds", "experiment-versions", "experiment-texts"].map((key) =>
          queries.invalidateQueries({ queryKey: [key] }),
        ),
      ),
  });
}

export function useStartExperiment() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: { name: string; settings: SettingValues }) =>
      answered(api.POST("/api/experiments", { body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["runs"] }),
  });
}

/** Sends a command to the queue; each answer contains the queue after it. */
export function useQueueCommand() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (command: QueueCommand) => answered(queueRequest(command)),
    onSuccess: (queue) => queries.setQueryData(["queue"], queue),
  });
}

type QueueCommand =
  | { readonly do: "add"; readonly name: string; readonly settings: SettingValues }
  | { readonly do: "remove"; readonly id: number }
  | { readonly do: "move"; readonly id: number; readonly place: number }
  | { readonly do: "run" }
  | { readonly do: "hold" };

function queueRequest(command: QueueCommand) {
  switch (command.do) {
    case "add": {
      const { name, settings } = command;
      return api.POST("/api/experiments/queue", { body: { name, settings } });
    }
    case "remove":
      return api.DELETE("/api/experiments/queue/{id}", { params: { path: { id: command.id } } });
    case "move": {
      const { id, place } = command;
      return api.PUT("/api/experiments/queue/{id}/place", { params: { path: { id } }, body: { place } });
    }
    case "run":
      return api.POST("/api/experiments/queue/run");
    case "hold":
      return api.POST("/api/experiments/queue/hold");
  }
}

/** Fetches the text of a built-in or own experiment, and its content; a deleted version has none. */
export function experimentTextQuery(name: string) {
  return queryOptions({
    queryKey: ["experiment-texts", name],
    queryFn: () => answered(api.GET("/api/experiments/texts/{name}", { params: { path: { name } } })),
  });
}

/** Fetches the versions of an own experiment, the newest first. */
export function experimentVersionsQuery(name: string) {
  return queryOptions({
    queryKey: ["experiment-versions", name],
    queryFn: async () =>
      (await answered(api.GET("/api/experiments/own/{name}/versions", { params: { path: { name } } })))
        .experiments,
  });
}

/** Fetches a run as an experiment, and the parts of the run that the experiment does not repeat. */
export function experimentAsRunQuery(run_id: number) {
  return queryOptions({
    queryKey: ["experiment-as-run", run_id],
    queryFn: () => answered(api.GET("/api/experiments/as-run/{run_id}", { params: { path: { run_id } } })),
  });
}

/** Checks a text without a simulation, which is fast: whether the service would refuse it, and why. */
export function checkedExperimentQuery(text: string) {
  return queryOptions({
    queryKey: ["checked-experiment", text],
    queryFn: () => answered(api.POST("/api/experiments/check", { body: { text, play: false } })),
    retry: false,
    refetchOnWindowFocus: false,
    gcTime: 60_000,
  });
}

/** Checks and simulates a text; repeats the request while the simulator is busy. */
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

/** Fetches the progress of this person's dry run; the page polls it while it shows the progress. */
export const dryRunProgressQuery = queryOptions({
  queryKey: ["dry-run-progress"],
  queryFn: () => answered(api.GET("/api/experiments/dry-run/progress")),
  refetchInterval: 500,
  gcTime: 0,
});

/** Starts a dry run and can cancel it; the dry run ends with its connection, also when the person leaves the page. */
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
