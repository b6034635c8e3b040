/** Machine, database, safety: what the System and Developer pages read and do. */

import { queryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import { answered, api } from "../wire/client";
import { fromCsv } from "../wire/csv";
import type { Fault, Flight, Injection } from "../wire/types";

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

/** Its samples as they are exported, t counted from the trip or trigger. They never change. */
export function flightSamplesQuery(id: number) {
  return queryOptions({
    queryKey: ["flights", id, "samples"],
    queryFn: async () => {
      const params = { path: { id, format: "csv" as const } };
      return fromCsv(await answered(api.GET("/api/flights/{id}/data.{format}", { params, parseAs: "text" })));
    },
    staleTime: Number.POSITIVE_INFINITY,
  });
}

/** Let the 3D view of the replay show a moment of it; `t` counts from the trip or trigger. */
export function showFlightMoment(id: number, t: number) {
  return answered(api.POST("/api/flights/{id}/replay", { params: { path: { id } }, body: { t } }));
}

/** The flight record that a fault is in: trips that follow each other share one. */
export function flightOf(flights: readonly Flight[], fault: Pick<Fault, "tick"> | null): Flight | undefined {
  const newest = flights.find(({ kind }) => kind === "trip"); // ticks begin anew with each loop process: older records may be of another one
  if (newest === undefined || fault === null) return undefined;
  const after_s = (fault.tick - newest.tick) / 1000;
  return after_s >= 0 && after_s <= newest.after_s ? newest : undefined;
}

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
