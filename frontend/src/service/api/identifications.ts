/** Identifications, their curves and predictions, spring tables, and identified parameters put in force. */

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

/** `body` is null while the form holds no order; `from` says from where: elsewhere it is told anew. */
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

/** A pause between two runs of one order. */

/** Lets the next run of the order under way wait, or begin. */
export function usePauseOrder() {
  return useMutation({
    mutationFn: (paused: boolean) => answered(api.PUT("/api/identifications/pause", { body: { paused } })),
  });
}

/** Models beside what judges them, and identified parameters put in force. */

/** The model of `run` beside the record of the run `of`. */
export function unseenQuery(run: number, of: number) {
  return queryOptions({
    queryKey: ["identifications", run, "unseen", of],
    queryFn: () =>
      answered(api.GET("/api/identifications/{id}/unseen", { params: { path: { id: run }, query: { of } } })),
    staleTime: Number.POSITIVE_INFINITY,
    retry: false,
  });
}

/** `made` tells the identifications that are there, `tuning` what is in force: both decide what is shown. */
export function trendQuery(made: string, tuning: string) {
  return queryOptions({
    queryKey: ["identification-trend", made, tuning],
    queryFn: () => answered(api.GET("/api/identification-trend")),
    placeholderData: (before) => before,
  });
}

/** The parameters in force, with what applying the identification of this estimate would change. */
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

/** Whatever is predicted rests on the parameters. */
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

function useParameterChange<Asked>(change: (asked: Asked) => Promise<Parameters>) {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: change,
    // after a refusal, too: others may have changed them, and those that no loop started with are in force all the same
    onSettled: () =>
      Promise.all(RESTS_ON_PARAMETERS.map((key) => queries.invalidateQueries({ queryKey: [key] }))),
  });
}
