/** Banks of models: queries, import, building, activation. */

import { queryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import { answered, api } from "../../wire/client";
import type { BankFile } from "../../wire/types";
import { OTHERS_MS } from "./polling";

/** Fetches how a new identification of one operating point would change the models of the active bank. */
export function differenceInUseQuery(run: number, lambdas: string) {
  return queryOptions({
    queryKey: ["banks", "in-use", "difference", run, lambdas],
    queryFn: () => answered(api.GET("/api/banks/in-use/difference", { params: { query: { run: [run] } } })),
  });
}

export function bankDifferenceQuery(id: number, other: number, lambdas: string) {
  return queryOptions({
    queryKey: ["banks", id, "difference", other, lambdas],
    queryFn: () =>
      answered(api.GET("/api/banks/{id}/difference", { params: { path: { id }, query: { other } } })),
  });
}

export function bankDetailQuery(id: number, lambdas: string) {
  return queryOptions({
    queryKey: ["banks", id, "detail", lambdas],
    queryFn: () => answered(api.GET("/api/banks/{id}/detail", { params: { path: { id } } })),
    placeholderData: (before) => before,
  });
}

export const banksQuery = queryOptions({
  queryKey: ["banks"],
  refetchInterval: OTHERS_MS,
  queryFn: async () => (await answered(api.GET("/api/banks"))).banks,
});

export function useImportBank() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: BankFile) => answered(api.POST("/api/banks/file", { body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["banks"] }),
  });
}

export function useBuildBank() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: { name: string; identifications: number[] }) =>
      answered(api.POST("/api/banks", { body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["banks"] }),
  });
}

export function useActivateBank() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (id: number) => answered(api.POST("/api/banks/{id}/activate", { params: { path: { id } } })),
    onSuccess: () =>
      Promise.all(["banks", "tuning"].map((key) => queries.invalidateQueries({ queryKey: [key] }))),
  });
}

/** Activates the geometric gains, without a bank. */
export function useActivateGeometry() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.POST("/api/banks/geometry/activate")),
    onSuccess: () =>
      Promise.all(["banks", "tuning"].map((key) => queries.invalidateQueries({ queryKey: [key] }))),
  });
}
