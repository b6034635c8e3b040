/** Everything that is read from the service by asking, with one key per thing. */

import { queryOptions } from "@tanstack/react-query";
import type { Stretch } from "../charts/viewport";
import { answered, api } from "../wire/client";
import type { IdentificationRequest } from "../wire/types";

const WHILE_RUNNING_MS = 700;

/** End states of the service, beside which a run is still going. */
export function isRunning(status: string): boolean {
  return status === "running";
}

export const sessionQuery = queryOptions({
  queryKey: ["session"],
  queryFn: () => answered(api.GET("/api/session")),
  retry: false,
});

export const healthQuery = queryOptions({
  queryKey: ["health"],
  queryFn: () => answered(api.GET("/api/health")),
});

export function previewQuery(lam_q: number, lam_S: number) {
  return queryOptions({
    queryKey: ["tuning", "preview", lam_q, lam_S],
    queryFn: () => answered(api.GET("/api/tuning/preview", { params: { query: { lam_q, lam_S } } })),
    placeholderData: (before) => before,
    staleTime: 60_000,
  });
}

/** What was saved for a bank; `bank` is null while the gains come from geometry. */
export function savedTuningQuery(bank: number | null) {
  return queryOptions({
    queryKey: ["tuning", "saved", bank],
    queryFn: () => answered(api.GET("/api/tuning/saved")),
  });
}

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

export function predictionQuery(body: IdentificationRequest) {
  return queryOptions({
    queryKey: ["prediction", body],
    queryFn: () => answered(api.POST("/api/identifications/prediction", { body })),
    placeholderData: (before) => before,
    staleTime: 60_000,
    retry: false,
  });
}

export const banksQuery = queryOptions({
  queryKey: ["banks"],
  queryFn: async () => (await answered(api.GET("/api/banks"))).banks,
});

export const experimentKindsQuery = queryOptions({
  queryKey: ["experiment-kinds"],
  queryFn: async () => (await answered(api.GET("/api/experiments"))).experiments,
  staleTime: Number.POSITIVE_INFINITY,
});

export const queueQuery = queryOptions({
  queryKey: ["queue"],
  queryFn: () => answered(api.GET("/api/experiments/queue")),
});

export function experimentQuery(id: number) {
  return queryOptions({
    queryKey: ["experiments", id],
    queryFn: () => answered(api.GET("/api/experiments/{id}", { params: { path: { id } } })),
    refetchInterval: (query) => (isRunning(query.state.data?.status ?? "") ? WHILE_RUNNING_MS : false),
  });
}

export interface RunFilter {
  readonly kind: string;
  readonly search: string;
  readonly limit: number;
  readonly offset: number;
}

export function runsQuery(filter: RunFilter) {
  const { kind, search, limit, offset } = filter;
  const query = { limit, offset, ...(kind === "" ? {} : { kind }), ...(search === "" ? {} : { search }) };
  return queryOptions({
    queryKey: ["runs", filter],
    queryFn: () => answered(api.GET("/api/runs", { params: { query } })),
    placeholderData: (before) => before,
  });
}

export function runQuery(id: number) {
  return queryOptions({
    queryKey: ["runs", id],
    queryFn: () => answered(api.GET("/api/runs/{id}", { params: { path: { id } } })),
    refetchInterval: (query) => (isRunning(query.state.data?.end_state ?? "") ? 2000 : false),
  });
}

export function lineageQuery(id: number) {
  return queryOptions({
    queryKey: ["runs", id, "lineage"],
    queryFn: () => answered(api.GET("/api/runs/{id}/lineage", { params: { path: { id } } })),
  });
}

export function runMarksQuery(id: number) {
  return queryOptions({
    queryKey: ["runs", id, "marks"],
    queryFn: async () =>
      (await answered(api.GET("/api/runs/{id}/marks", { params: { path: { id } } }))).marks,
  });
}

export const checklistQuery = queryOptions({
  queryKey: ["checklist"],
  queryFn: async () => (await answered(api.GET("/api/checklist"))).steps,
});

export function samplesQuery(id: number, stretch: Stretch, points: number, signals: readonly string[]) {
  const query = { from: stretch.from_s, to: stretch.to_s, points, signals: signals.join(",") };
  return queryOptions({
    queryKey: ["runs", id, "samples", query],
    queryFn: () => answered(api.GET("/api/runs/{id}/samples", { params: { path: { id }, query } })),
    staleTime: Number.POSITIVE_INFINITY,
    gcTime: 60_000,
  });
}
