/** Machine, database, safety: what the System and Developer pages read and do. */

import { queryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import { answered, api } from "../wire/client";
import type { Injection } from "../wire/types";

export const systemQuery = queryOptions({
  queryKey: ["system"],
  queryFn: () => answered(api.GET("/api/system")),
  refetchInterval: 5000,
});

export const flightsQuery = queryOptions({
  queryKey: ["flights"],
  queryFn: async () => (await answered(api.GET("/api/flights"))).flights,
  refetchInterval: 5000,
});

export const faultsQuery = queryOptions({
  queryKey: ["faults"],
  queryFn: () => answered(api.GET("/api/faults")),
  staleTime: Number.POSITIVE_INFINITY,
});

export function useBackup() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.POST("/api/system/backups")),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["system"] }),
  });
}

export function useCheck() {
  return useMutation({
    mutationFn: async () => (await answered(api.POST("/api/system/check"))).problems,
  });
}

export const recordingsQuery = queryOptions({
  queryKey: ["recordings"],
  queryFn: () => answered(api.GET("/api/system/recordings")),
  refetchInterval: 60_000,
});

export function useRemoveRecordings() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (runs: number[]) => answered(api.POST("/api/system/recordings/removal", { body: { runs } })),
    onSuccess: (left) => queries.setQueryData(recordingsQuery.queryKey, left),
  });
}

export function useInject() {
  return useMutation({
    mutationFn: (body: Injection) => answered(api.POST("/api/faults/injection", { body })),
  });
}

export function useMend() {
  return useMutation({ mutationFn: () => answered(api.DELETE("/api/faults/injection")) });
}
