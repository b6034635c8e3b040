/** Recorded samples: runs, ranges of runs, flight records, the trigger, and a replayed recording. */

import { queryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import { fixed } from "../../samples/format";
import { fillText } from "../../samples/texts";
import type { TimeRange } from "../../samples/timeSeries";
import type { components } from "../../wire/api.gen";
import { answered, api, resultIn } from "../../wire/client";
import { decodeCurves, fromCsv } from "../../wire/curves";
import type { Fault, Flight, PlayerOrder, Trigger, TriggerOrder } from "../../wire/types";
import { TEXTS } from "../texts";

export const flightsQuery = queryOptions({
  queryKey: ["flights"],
  queryFn: async () => (await answered(api.GET("/api/flights"))).flights,
  refetchInterval: 5000,
});

/** Fetches the exported samples of a flight record, with t from the trip or trigger. They never change. */
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

/** Shows a moment of a flight record in the 3D view; `t` counts from the trip or trigger. */
export function showFlightMoment(id: number, t: number) {
  return answered(api.POST("/api/flights/{id}/replay", { params: { path: { id } }, body: { t } }));
}

/** Returns the flight record that contains a fault: successive trips share one record. */
export function flightOf(flights: readonly Flight[], fault: Pick<Fault, "tick"> | null): Flight | undefined {
  // ticks restart with each loop process: older records may belong to an earlier one
  const newest = flights.find(({ kind }) => kind === "trip");
  if (newest === undefined || fault === null) return undefined;
  const after_s = (fault.tick - newest.tick) / 1000;
  return after_s >= 0 && after_s <= newest.after_s ? newest : undefined;
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

export function recordingQuery(id: number, range: TimeRange, points: number, signals: readonly string[]) {
  const query = { from: range.from_s, to: range.to_s, points, signals: signals.join(",") };
  return queryOptions({
    queryKey: ["runs", id, "samples", query],
    queryFn: async () => {
      const params = { path: { id }, query };
      const message = await answered(
        api.GET("/api/runs/{id}/samples.bin", { params, parseAs: "arrayBuffer" }),
      );
      return decodeCurves(message, signals);
    },
    staleTime: Number.POSITIVE_INFINITY,
    gcTime: 60_000,
  });
}

/** Shows a moment of a run in the 3D view. */
export function showRunMoment(run: number, t: number) {
  return answered(api.POST("/api/runs/{id}/replay", { params: { path: { id: run } }, body: { t } }));
}

/** Fetches the recording that replaces the plant; it does not change while the service runs. */
export const playedQuery = queryOptions({
  queryKey: ["player"],
  queryFn: () => answered(api.GET("/api/player")),
  staleTime: Number.POSITIVE_INFINITY,
  retry: false,
});

/** Plays, pauses, sets the speed or seeks; omitted fields do not change. */
export function usePlayerCommand() {
  return useMutation({
    mutationFn: (body: Partial<PlayerOrder>) => answered(api.PUT("/api/player", { body })),
  });
}

/** Conditions of the trigger, with their labels. */

export const CONDITIONS: readonly { readonly value: TriggerOrder["condition"]; readonly label: string }[] = [
  { value: "above", label: TEXTS.above },
  { value: "below", label: TEXTS.below },
  { value: "rising", label: TEXTS.rising },
  { value: "falling", label: TEXTS.falling },
  { value: "inside", label: TEXTS.inside },
  { value: "outside", label: TEXTS.outside },
];

export function isWindow(condition: TriggerOrder["condition"]): boolean {
  return condition === "inside" || condition === "outside";
}

/** Describes the state of the trigger; quantities in SI, as in the log. */
export function describeTrigger(trigger: Trigger | null): string {
  if (trigger === null) return TEXTS.notArmed;
  const made = fillText(TEXTS.captured, { count: trigger.captured, total: trigger.captures });
  if (trigger.phase === "armed") return fillText(TEXTS.armed, { condition: trigger.says, made });
  if (trigger.phase === "capturing") {
    return fillText(TEXTS.capturing, { condition: trigger.says, left: fixed(trigger.left_s, 1) });
  }
  return fillText(TEXTS.notArmedBecause, { reason: trigger.ended, made });
}

export function useArmTrigger() {
  return useMutation({
    mutationFn: (body: TriggerOrder) => answered(api.PUT("/api/trigger", { body })),
  });
}

export function useDisarmTrigger() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.DELETE("/api/trigger")),
    onSuccess: () => queries.invalidateQueries({ queryKey: flightsQuery.queryKey }),
  });
}

/** Results that the service computes from every sample of a range of a recorded run. */

export type RecordedStatistics = components["schemas"]["RecordedStatistics"];
export type RecordedSpectra = components["schemas"]["RecordedSpectra"];
export type RecordedValues = components["schemas"]["RecordedValues"];

/** Cancels a computation, and receives its progress, 0 to 1. */
export interface Waiting {
  readonly signal: AbortSignal;
  onShare(share: number): void;
}

/** Fetches statistics of a range. Throws RequestError for refusals, Error for an incomplete answer. */
export async function rangeStatistics(
  run: number,
  range: TimeRange,
  signals: readonly string[],
  { signal, onShare }: Waiting,
): Promise<RecordedStatistics> {
  const params = rangeParams(run, range, signals);
  const body = await answered(api.GET("/api/runs/{id}/statistics", { params, parseAs: "stream", signal }));
  return await resultIn(streamOf(body), onShare);
}

/** Fetches spectra of a range. Throws like `rangeStatistics`. */
export async function rangeSpectra(
  run: number,
  range: TimeRange,
  signals: readonly string[],
  { signal, onShare }: Waiting,
): Promise<RecordedSpectra> {
  const params = rangeParams(run, range, signals);
  const body = await answered(api.GET("/api/runs/{id}/spectra", { params, parseAs: "stream", signal }));
  return await resultIn(streamOf(body), onShare);
}

/** Fetches the values of the last sample at or before each time. Throws RequestError. */
export function valuesAt(
  run: number,
  times_s: readonly number[],
  signals: readonly string[],
  signal: AbortSignal,
): Promise<RecordedValues> {
  const query = { at: [...times_s], signals: signals.join(",") };
  return answered(api.GET("/api/runs/{id}/values", { params: { path: { id: run }, query }, signal }));
}

/** Returns the address of the CSV file with every sample of a range. */
export function rangeFile(run: number, { from_s, to_s }: TimeRange, signals: readonly string[]): string {
  const query = new URLSearchParams({ from: String(from_s), to: String(to_s), signals: signals.join(",") });
  return `./api/runs/${run}/range.csv?${query}`;
}

function rangeParams(run: number, { from_s, to_s }: TimeRange, signals: readonly string[]) {
  return { path: { id: run }, query: { from: from_s, to: to_s, signals: signals.join(",") } };
}

function streamOf(body: unknown): ReadableStream<Uint8Array> {
  if (body instanceof ReadableStream) return body;
  throw new Error(TEXTS.emptyAnswer);
}
