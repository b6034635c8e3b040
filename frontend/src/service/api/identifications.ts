/** Identifications, their curves and predictions, spring tables, and the application of identified parameters. */

import { queryOptions, skipToken, useMutation, useQueryClient } from "@tanstack/react-query";
import { answered, api } from "../../wire/client";
import type { IdentificationRequest, Parameters, SpringTableRequest } from "../../wire/types";
import { isRunning, WHILE_RUNNING_MS } from "./polling";

export const identificationsQuery = queryOptions({
  queryKey: ["identifications"],
  queryFn: async () => (await answered(api.GET("/api/identifications"))).identifications,
});

export function identificationQuery(id: number) {
  return queryOptions({
    queryKey: ["identifications", id],
    queryFn: () => answered(api.GET("/api/identifications/{id}", { params: { path: { id } } })),
    refetchInterval: (query) => (isRunning(query.state.data?.status ?? "") ? WHILE_RUNNING_MS : false),
  });
}

export const identificationKindsQuery = queryOptions({
  queryKey: ["identification-kinds"],
  queryFn: async () => (await answered(api.GET("/api/identification-kinds"))).kinds,
  staleTime: Number.POSITIVE_INFINITY,
});

export function curvesQuery(id: number) {
  return queryOptions({
    queryKey: ["identifications", id, "curves"],
    queryFn: () => answered(api.GET("/api/identifications/{id}/curves", { params: { path: { id } } })),
    staleTime: Number.POSITIVE_INFINITY,
  });
}

export const springTablesQuery = queryOptions({
  queryKey: ["spring-tables"],
  queryFn: async () => (await answered(api.GET("/api/spring-tables"))).tables,
});

export function springTableCurvesQuery(id: number) {
  return queryOptions({
    queryKey: ["spring-tables", id, "curves"],
    queryFn: () => answered(api.GET("/api/spring-tables/{id}/curves", { params: { path: { id } } })),
    staleTime: Number.POSITIVE_INFINITY,
  });
}

/** `body` is null while the form has no valid request; `from` is the start state: another one has another prediction. */
export function predictionQuery(body: IdentificationRequest | null, from: string) {
  return queryOptions({
    queryKey: ["prediction", body, from],
    queryFn:
      body === null ? skipToken : () => answered(api.POST("/api/identifications/prediction", { body })),
    placeholderData: (before) => before,
    staleTime: 60_000,
    retry: false,
  });
}

export function useStartIdentification() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: IdentificationRequest) => answered(api.POST("/api/identifications", { body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["identifications"] }),
  });
}

export function useAddSpringTable() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: SpringTableRequest) => answered(api.POST("/api/spring-tables", { body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["spring-tables"] }),
  });
}

/** Pauses the current series of identifications before its next run, or resumes it. */
export function usePauseOrder() {
  return useMutation({
    mutationFn: (paused: boolean) => answered(api.PUT("/api/identifications/pause", { body: { paused } })),
  });
}

/** Fetches the model of `run` with its prediction of the validation data of the run `of`. */
export function unseenQuery(run: number, of: number) {
  return queryOptions({
    queryKey: ["identifications", run, "unseen", of],
    queryFn: () =>
      answered(api.GET("/api/identifications/{id}/unseen", { params: { path: { id: run }, query: { of } } })),
    staleTime: Number.POSITIVE_INFINITY,
    retry: false,
  });
}

/** `made` identifies the stored identifications and `tuning` the active tuning: the trend depends on both. */
export function trendQuery(made: string, tuning: string) {
  return queryOptions({
    queryKey: ["identification-trend", made, tuning],
    queryFn: () => answered(api.GET("/api/identification-trend")),
    placeholderData: (before) => before,
  });
}

/** Fetches the active parameters, and the changes that applying this estimate would make. */
export function parametersQuery(estimate: number | null) {
  return queryOptions({
    queryKey: ["parameters", estimate],
    queryFn: () =>
      answered(api.GET("/api/parameters", { params: { query: estimate === null ? {} : { estimate } } })),
  });
}

export function useApplyParameters() {
  return useParameterChange((estimate: number) =>
    answered(api.POST("/api/parameters", { body: { estimate } })),
  );
}

export function useUndoParameters() {
  return useParameterChange((version: number) =>
    answered(api.POST("/api/parameters/undo", { body: { version } })),
  );
}

/** Keys of the queries whose results depend on the parameters. */
export const RESTS_ON_PARAMETERS = [
  "parameters",
  "prediction",
  "identification-trend",
  "identification-kinds",
  "experiment-kinds",
  "plant-numbers",
  "tuning",
  "banks",
  "checklist",
];

function useParameterChange<Request>(change: (request: Request) => Promise<Parameters>) {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: change,
    // also after a refusal: others may have changed them, and applied parameters are active even if the loop did not start
    onSettled: () =>
      Promise.all(RESTS_ON_PARAMETERS.map((key) => queries.invalidateQueries({ queryKey: [key] }))),
  });
}
