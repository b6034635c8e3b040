/** Figures that the service computes from every sample of a range of a recorded run. */

import type { Stretch } from "../samples/stretch";
import type { components } from "../wire/api.gen";
import { answered, api } from "../wire/client";
import { resultIn } from "../wire/lines";

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
