import { queryOptions, useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useEffect } from "react";
import { useLiveStore } from "../live/react";
import { fixed } from "../samples/format";
import { type DerivedSignal, setDerived } from "../samples/formula";
import type { Stretch } from "../samples/timeSeries";
import type { components } from "../wire/api.gen";
import { answered, api, resultIn } from "../wire/client";
import type { Formula, FormulaText, Trigger, TriggerOrder } from "../wire/types";
import { flightsQuery } from "./system";

/** Derived signals of the station: read, written and removed. */

/** So often [ms] it is asked what others have written. */
const AGAIN_MS = 30_000;
const NONE: readonly Formula[] = [];

export const formulasQuery = queryOptions({
  queryKey: ["formulas"],
  queryFn: async () => {
    const { formulas } = await answered(api.GET("/api/formulas"));
    setDerived(formulas); // before whoever waits for them is rendered
    return formulas;
  },
  refetchInterval: AGAIN_MS,
});

export function useDerived(): readonly DerivedSignal[] {
  return useQuery(formulasQuery).data ?? NONE;
}

/** Have the live window hold them too. */
export function useLiveFormulas(): void {
  const store = useLiveStore();
  const derived = useDerived();
  useEffect(() => store.setFormulas(derived), [store, derived]);
}

export function useFormulas(): readonly Formula[] {
  return useQuery(formulasQuery).data ?? NONE;
}

export function usePutFormula() {
  const renew = useRenew();
  return useMutation({
    mutationFn: ({ name, ...body }: FormulaText & { name: string }) =>
      answered(api.PUT("/api/formulas/{name}", { params: { path: { name } }, body })),
    onSuccess: renew,
  });
}

export function useRemoveFormula() {
  const renew = useRenew();
  return useMutation({
    mutationFn: (name: string) =>
      answered(api.DELETE("/api/formulas/{name}", { params: { path: { name } } })),
    onSuccess: renew,
  });
}

/** What was read of recordings under the name of a formula is what it was before. */
function useRenew(): () => Promise<void> {
  const queries = useQueryClient();
  return async () => {
    await queries.invalidateQueries({ queryKey: formulasQuery.queryKey });
    await queries.invalidateQueries({
      predicate: ({ queryKey }) => queryKey[0] === "runs" && queryKey[2] === "samples",
    });
  };
}

/** The trigger: what is armed, in words, and the orders that arm and disarm it. */

export const CONDITIONS: readonly { readonly value: TriggerOrder["condition"]; readonly label: string }[] = [
  { value: "above", label: "above (level)" },
  { value: "below", label: "below (level)" },
  { value: "rising", label: "rising through (edge)" },
  { value: "falling", label: "falling through (edge)" },
  { value: "inside", label: "inside (window)" },
  { value: "outside", label: "outside (window)" },
];

export function isWindow(condition: TriggerOrder["condition"]): boolean {
  return condition === "inside" || condition === "outside";
}

/** What it does at present; quantities in SI, as the log has them. */
export function triggerWords(trigger: Trigger | null): string {
  if (trigger === null) return "Not armed";
  const made = `${trigger.captured} of ${trigger.captures} captured`;
  if (trigger.phase === "armed") return `Armed: ${trigger.says}; ${made}`;
  if (trigger.phase === "capturing") return `Recording: ${trigger.says}; ${fixed(trigger.left_s, 1)} s left`;
  return `Not armed: ${trigger.ended}; ${made}`;
}

export function useArm() {
  return useMutation({
    mutationFn: (body: TriggerOrder) => answered(api.PUT("/api/trigger", { body })),
  });
}

export function useDisarm() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.DELETE("/api/trigger")),
    onSuccess: () => queries.invalidateQueries({ queryKey: flightsQuery.queryKey }),
  });
}

/** Figures that the service computes from every sample of a range of a recorded run. */

export type RecordedStatistics = components["schemas"]["RecordedStatistics"];
export type RecordedSpectra = components["schemas"]["RecordedSpectra"];
export type RecordedValues = components["schemas"]["RecordedValues"];

/** Whoever waits: may leave, and hears how far it is, 0 to 1. */
export interface Waiting {
  readonly signal: AbortSignal;
  onShare(share: number): void;
}

/** Statistics of every sample of a range. Throws RequestError for refusals, Error for an answer that broke off. */
export async function rangeStatistics(
  run: number,
  range: Stretch,
  signals: readonly string[],
  { signal, onShare }: Waiting,
): Promise<RecordedStatistics> {
  const params = asked(run, range, signals);
  const body = await answered(api.GET("/api/runs/{id}/statistics", { params, parseAs: "stream", signal }));
  return await resultIn(streamOf(body), onShare);
}

/** Spectra of every sample of a range. Throws like `rangeStatistics`. */
export async function rangeSpectra(
  run: number,
  range: Stretch,
  signals: readonly string[],
  { signal, onShare }: Waiting,
): Promise<RecordedSpectra> {
  const params = asked(run, range, signals);
  const body = await answered(api.GET("/api/runs/{id}/spectra", { params, parseAs: "stream", signal }));
  return await resultIn(streamOf(body), onShare);
}

/** The values at the samples at or before some times. Throws RequestError. */
export function valuesAt(
  run: number,
  times_s: readonly number[],
  signals: readonly string[],
  signal: AbortSignal,
): Promise<RecordedValues> {
  const query = { at: [...times_s], signals: signals.join(",") };
  return answered(api.GET("/api/runs/{id}/values", { params: { path: { id: run }, query }, signal }));
}

/** Where the file of every sample of a range is downloaded from. */
export function rangeFile(run: number, { from_s, to_s }: Stretch, signals: readonly string[]): string {
  const query = new URLSearchParams({ from: String(from_s), to: String(to_s), signals: signals.join(",") });
  return `./api/runs/${run}/range.csv?${query}`;
}

function asked(run: number, { from_s, to_s }: Stretch, signals: readonly string[]) {
  return { path: { id: run }, query: { from: from_s, to: to_s, signals: signals.join(",") } };
}

function streamOf(body: unknown): ReadableStream<Uint8Array> {
  if (body instanceof ReadableStream) return body;
  throw new Error("The service gave an answer without content. Try again.");
}
