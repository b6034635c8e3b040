/** What the page asks of studies, and what it has done with them. */

import { queryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import { answered, api } from "../../wire/client";
import type { Study } from "../../wire/types";

const WHILE_COMPUTED_MS = 2000;
const RESTING = ["done", "stopped"];

/** Whether a study changes by itself. */
export function isUnderWay(study: Study): boolean {
  return !RESTING.includes(study.state);
}

export const studiesQuery = queryOptions({
  queryKey: ["studies"],
  queryFn: async () => (await answered(api.GET("/api/studies"))).studies,
  refetchInterval: ({ state: { data } }) => (data?.some(isUnderWay) ? WHILE_COMPUTED_MS : false),
});

/** What a cell of a map is asked to show of several runs. */
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

/** A text looked over: what it says as plain data, how many runs it has, why it would be refused. */
export function checkedStudyQuery(text: string) {
  return queryOptions({
    queryKey: ["checked-study", text],
    queryFn: () => answered(api.POST("/api/studies/check", { body: { text } })),
    retry: false,
    refetchOnWindowFocus: false,
    gcTime: 60_000,
  });
}

/** The numbers of the plant that a study can vary. */
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
