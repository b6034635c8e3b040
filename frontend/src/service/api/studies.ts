/** Studies: queries, checks, starts, stops and resumption. */

import { queryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import { answered, api } from "../../wire/client";
import type { Study } from "../../wire/types";

const WHILE_COMPUTED_MS = 2000;
const FINISHED = ["done", "stopped"];

/** Whether a study is in progress. */
export function isUnderWay(study: Study): boolean {
  return !FINISHED.includes(study.state);
}

export const studiesQuery = queryOptions({
  queryKey: ["studies"],
  queryFn: async () => (await answered(api.GET("/api/studies"))).studies,
  refetchInterval: ({ state: { data } }) => (data?.some(isUnderWay) ? WHILE_COMPUTED_MS : false),
});

/** Statistic of several runs that a cell of a map shows. */
export type MapPick = "worst" | "mean" | "least" | "largest" | "deviation" | "p5" | "median" | "p95";

export function studyQuery(id: number, pick: MapPick = "worst") {
  return queryOptions({
    queryKey: ["studies", id, pick],
    queryFn: () => answered(api.GET("/api/studies/{id}", { params: { path: { id }, query: { pick } } })),
    placeholderData: (before) => before,
    refetchInterval: ({ state: { data } }) =>
      data !== undefined && isUnderWay(data.study) ? WHILE_COMPUTED_MS : false,
    retry: false,
  });
}

/** Checks a text: its content as plain data, its number of runs, and the reason of a refusal. */
export function checkedStudyQuery(text: string) {
  return queryOptions({
    queryKey: ["checked-study", text],
    queryFn: () => answered(api.POST("/api/studies/check", { body: { text } })),
    retry: false,
    refetchOnWindowFocus: false,
    gcTime: 60_000,
  });
}

/** Fetches the plant parameters that a study can vary. */
export const plantNumbersQuery = queryOptions({
  queryKey: ["plant-numbers"],
  queryFn: async () => (await answered(api.GET("/api/studies/numbers"))).numbers,
});

export function useBeginStudy() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (text: string) => answered(api.POST("/api/studies", { body: { text } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["studies"] }),
  });
}

export function useStopStudy() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (id: number) => answered(api.POST("/api/studies/{id}/stop", { params: { path: { id } } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["studies"] }),
  });
}

export function useResumeStudy() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (id: number) => answered(api.POST("/api/studies/{id}/resume", { params: { path: { id } } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["studies"] }),
  });
}
