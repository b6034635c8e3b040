/** Stored runs: lists, details, notes and tags, saved searches, and comparisons. */

import { queryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import type { TimeRange } from "../../samples/timeSeries";
import type { operations } from "../../wire/api.gen";
import { answered, api } from "../../wire/client";
import { excerptOf } from "../../wire/curves";
import type { Differences } from "../../wire/types";
import { isRunning } from "./polling";

interface RunFilter {
  /** Kinds, separated by commas; all kinds if empty. */
  readonly kind?: string;
  /** Searched text. */
  readonly search?: string;
  /** Search expressions, all of which must match; empty ones have no effect. */
  readonly where?: readonly string[];
  readonly limit: number;
  readonly offset: number;
}

export function runsQuery(filter: RunFilter) {
  const { kind = "", search = "", where = [], limit, offset } = filter;
  const conditions = where.filter((part) => part.trim() !== "");
  const query = {
    limit,
    offset,
    ...(kind === "" ? {} : { kind }),
    ...(search === "" ? {} : { search }),
    ...(conditions.length === 0 ? {} : { where: conditions }),
  };
  return queryOptions({
    queryKey: ["runs", filter],
    queryFn: () => answered(api.GET("/api/runs", { params: { query } })),
    placeholderData: (before) => before,
    retry: false,
  });
}

export function runQuery(id: number) {
  return queryOptions({
    queryKey: ["runs", id],
    queryFn: () => answered(api.GET("/api/runs/{id}", { params: { path: { id } } })),
    refetchInterval: ({ state: { data } }) =>
      isRunning(data?.end_state ?? "") || data?.evaluation === "under_way" ? 2000 : false,
  });
}

export function lineageQuery(id: number) {
  return queryOptions({
    queryKey: ["runs", id, "lineage"],
    queryFn: () => answered(api.GET("/api/runs/{id}/lineage", { params: { path: { id } } })),
  });
}

export const searchWordsQuery = queryOptions({
  queryKey: ["runs", "words"],
  queryFn: () => answered(api.GET("/api/run-words")),
});

export const savedSearchesQuery = queryOptions({
  queryKey: ["saved-searches"],
  queryFn: async () => (await answered(api.GET("/api/saved-searches"))).searches,
});

/** `metric` "" selects the first metric. */
export function metricHistoryQuery(kind: string, metric: string, where: string, everywhere: boolean) {
  return queryOptions({
    queryKey: ["runs", "metric-history", kind, metric, where, everywhere],
    queryFn: () =>
      answered(api.GET("/api/metric-history", { params: { query: { kind, metric, where, everywhere } } })),
    placeholderData: (before) => before,
    retry: false,
  });
}

/** Fetches the planned references; `recorded`: the first samples, which show where the run began, are stored. */
export function plannedQuery(id: number, recorded: boolean) {
  return queryOptions({
    queryKey: ["runs", id, "planned", recorded],
    queryFn: () => answered(api.GET("/api/runs/{id}/planned", { params: { path: { id } } })),
    placeholderData: (before) => before,
    staleTime: Number.POSITIVE_INFINITY,
  });
}

export function runMarksQuery(id: number) {
  return queryOptions({
    queryKey: ["runs", id, "marks"],
    queryFn: async () =>
      (await answered(api.GET("/api/runs/{id}/marks", { params: { path: { id } } }))).marks,
  });
}

export function useSetNote(id: number) {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (note: string) =>
      answered(api.PATCH("/api/runs/{id}", { params: { path: { id } }, body: { note } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["runs"] }),
  });
}

/** Adds a tag to a run, or removes it. */
export function useTag(id: number) {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: ({ tag, put }: { tag: string; put: boolean }) =>
      answered(
        put
          ? api.POST("/api/runs/{id}/tags", { params: { path: { id } }, body: { tag } })
          : api.DELETE("/api/runs/{id}/tags/{tag}", { params: { path: { id, tag } } }),
      ),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["runs"] }),
  });
}

export function useSaveSearch() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: ({ name, where }: { name: string; where: string }) =>
      answered(api.PUT("/api/saved-searches/{name}", { params: { path: { name } }, body: { where } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["saved-searches"] }),
  });
}

export function useForgetSearch() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (name: string) =>
      answered(api.DELETE("/api/saved-searches/{name}", { params: { path: { name } } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["saved-searches"] }),
  });
}

/** Evaluates a run from its stored data. */
export function useEvaluate(run: number) {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.POST("/api/runs/{id}/evaluation", { params: { path: { id: run } } })),
    onSettled: () => queries.invalidateQueries({ queryKey: ["runs"] }),
  });
}

type Asked = operations["compare_runs"]["parameters"]["query"];

/** Selection of a comparison: the runs, the reference run and the alignment. */
export type ComparisonAsked = Required<Asked> & { readonly reference: number };

export function comparisonQuery(query: ComparisonAsked) {
  return queryOptions({
    queryKey: ["runs", "comparison", query],
    queryFn: () => answered(api.GET("/api/run-comparison", { params: { query } })),
    placeholderData: (before) => before,
  });
}

/** Fetches the differences of a signal over a range of the reference; `band` is null without a tolerance. */
export function differencesQuery(
  asked: ComparisonAsked,
  signal: string,
  band: number | null,
  points: number,
  range?: TimeRange,
) {
  const query = { ...asked, signal, points, ...(band === null ? {} : { band }), ...range };
  return queryOptions({
    queryKey: ["runs", "differences", query],
    queryFn: () => answered(api.GET("/api/run-comparison/differences", { params: { query } })),
    staleTime: Number.POSITIVE_INFINITY,
    gcTime: 60_000,
  });
}

/** Converts differences to curves; `named` returns the name of each, or null to omit it. */
export function curvesOf(found: Differences, named: (run: number) => string | null) {
  const signals = found.runs.flatMap(({ run, minimum, maximum }) => {
    const name = named(run);
    return name === null ? [] : [[name, { unit: found.unit, minimum, maximum }]];
  });
  return excerptOf({ ...found, run: found.reference, signals: Object.fromEntries(signals) });
}

/** Returns the address of the comparison as a CSV file. */
export function comparisonFile(content: "curves" | "table", asked: ComparisonAsked, signal: string): string {
  const { run, ...rest } = asked;
  const words = [...run.map((one) => ["run", one]), ...Object.entries(rest), ["signal", signal]];
  return `./api/run-comparison/${content}.csv?${words.map(([name, value]) => `${name}=${value}`).join("&")}`;
}
