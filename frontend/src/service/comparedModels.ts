/** Models beside what judges them, and identified parameters put in force. */

import { queryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import { answered, api } from "../wire/client";
import type { Parameters } from "../wire/types";

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
