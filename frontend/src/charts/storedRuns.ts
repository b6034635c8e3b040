import type { Basis, Figures, SignalSpectrum, Spectra, Statistics } from "../samples/analysis";
import { fillText } from "../samples/texts";
import type { TimeRange } from "../samples/timeSeries";
import {
  type RecordedSpectra,
  type RecordedStatistics,
  rangeFile,
  rangeSpectra,
  rangeStatistics,
  valuesAt,
  type Waiting,
} from "../service/api/recordings";
import { PERIOD_S } from "../wire/sample.gen";
import { splitName } from "./sources";
import { TEXTS } from "./texts";

/** Data that the service computes from every stored sample, and the file of the samples. */

/** Values at one time, by signal; NaN without a value or without a sample. */
export type Moment = ReadonlyMap<string, number>;

export interface StoredData {
  statistics(names: readonly string[], range: TimeRange, waiting: Waiting): Promise<Figures>;
  spectra(names: readonly string[], range: TimeRange, waiting: Waiting): Promise<Spectra>;
  /** Values in the order of the times. */
  values(names: readonly string[], times_s: readonly number[], signal: AbortSignal): Promise<Moment[]>;
  /** Address of the file with every sample of a range; null if the range contains none. */
  file(names: readonly string[], range: TimeRange): string | null;
  /** Source of the file: "run 12". */
  readonly fileOf: string;
}

/** Values at single times that only the service has; requested once the times are stable. */

export class StoredMoments {
  private readonly found = new Map<number, Moment>();
  private lastKey = "";
  private requested = "";
  private request = new AbortController();
  private failed = "";

  constructor(
    private readonly stored: StoredData,
    private readonly names: readonly string[],
  ) {}

  /** Reason why the last request failed; empty if it did not, or is in progress. */
  get problem(): string {
    return this.failed;
  }

  /** Called repeatedly: requests times that are the same in two calls, and removes values of other times. */
  want(times_s: readonly number[]): void {
    const missing = times_s.filter((time_s) => !this.found.has(time_s));
    const key = missing.join(" ");
    const isStable = key === this.lastKey;
    this.lastKey = key;
    if (key === "" || !isStable || key === this.requested) return;
    this.requested = key;
    this.failed = "";
    this.request.abort();
    this.request = new AbortController();
    const { signal } = this.request;
    this.stored
      .values(this.names, missing, signal)
      .then((moments) => {
        if (signal.aborted) return;
        for (const known of [...this.found.keys()]) if (!times_s.includes(known)) this.found.delete(known);
        for (const [n, moment] of moments.entries()) this.found.set(missing[n] as number, moment);
        this.requested = "";
      })
      .catch((error: Error) => {
        if (!signal.aborted) this.failed = error.message;
      });
  }

  /** A value in SI, NaN without a value; null if it is not loaded. */
  at(name: string, time_s: number): number | null {
    const moment = this.found.get(time_s);
    return moment === undefined ? null : (moment.get(name) ?? Number.NaN);
  }

  /** Aborts the current request. */
  close(): void {
    this.request.abort();
  }
}

/** Recorded runs on one time axis; the service computes results from every sample. Pure except for requests. */

export interface StoredRun {
  readonly id: number;
  readonly duration_s: number;
  /** Shift of the run's times on the axis of the charts. */
  readonly offset_s?: number;
}

/** Rounding tolerance of a time at the first or the last sample, because times on the axis are sums. */
const ROUNDING_S = PERIOD_S / 2;

/** Part of a request for one run: signals as drawn and as recorded, and the range on the run's time axis. */
interface Part {
  readonly run: StoredRun;
  readonly drawn: readonly string[];
  readonly recorded: readonly string[];
  readonly range: TimeRange;
}

export class StoredRuns implements StoredData {
  constructor(private readonly runs: readonly StoredRun[]) {}

  get fileOf(): string {
    return fillText(TEXTS.run, { run: String(this.runs[0]?.id) });
  }

  async statistics(names: readonly string[], range: TimeRange, waiting: Waiting): Promise<Figures> {
    const found = await this.each(names, range, waiting, ({ run, range: own, recorded }, shared) =>
      rangeStatistics(run.id, own, recorded, shared),
    );
    const signals = found.flatMap(([part, result]) =>
      part.drawn.map((name, n): [string, Statistics] => [
        name,
        statisticsOf(result, part.recorded[n] as string, offsetOf(part.run)),
      ]),
    );
    return { basis: found.map(([part, result]) => this.basis(part, result)), signals: new Map(signals) };
  }

  async spectra(names: readonly string[], range: TimeRange, waiting: Waiting): Promise<Spectra> {
    const found = await this.each(names, range, waiting, ({ run, range: own, recorded }, shared) =>
      rangeSpectra(run.id, own, recorded, shared),
    );
    const signals = new Map<string, SignalSpectrum>();
    const reasons = new Map<string, string>(names.map((name) => [name, TEXTS.runHasNoSample]));
    for (const [part, result] of found) {
      part.drawn.forEach((name, n) => {
        const { spectrum, reason } = spectrumOf(result, part.recorded[n] as string);
        if (spectrum === null) reasons.set(name, reason);
        else reasons.delete(name);
        if (spectrum !== null) signals.set(name, spectrum);
      });
    }
    return { basis: found.map(([part, result]) => this.basis(part, result)), signals, reasons };
  }

  async values(names: readonly string[], times_s: readonly number[], signal: AbortSignal): Promise<Moment[]> {
    const moments = times_s.map(() => new Map<string, number>());
    await Promise.all(
      this.runs.map(async (run, of) => {
        const drawn = names.filter((name) => splitName(name).of === of);
        const last_s = lastOf(run);
        const inside = times_s.flatMap((time_s, n) => {
          const own_s = time_s - offsetOf(run);
          const within = own_s > -ROUNDING_S && own_s < last_s + PERIOD_S + ROUNDING_S;
          return within ? [{ n, at_s: Math.min(Math.max(own_s, 0), last_s) }] : [];
        });
        if (drawn.length === 0 || inside.length === 0) return;
        const recorded = drawn.map((name) => splitName(name).signal);
        const at = inside.map(({ at_s }) => at_s);
        const found = await valuesAt(run.id, at, recorded, signal);
        found.moments.forEach(({ t, at_s, values }, index) => {
          // An older sample does not belong to this time: the samples after it are missing.
          if (at_s - t > 1.5 * found.period_s) return;
          const moment = moments[inside[index]?.n ?? -1];
          drawn.forEach((name, n) => {
            moment?.set(name, values[recorded[n] as string] ?? Number.NaN);
          });
        });
      }),
    );
    return moments;
  }

  file(names: readonly string[], range: TimeRange): string | null {
    const first = this.parts(names, range).find(({ run }) => run === this.runs[0]);
    return first === undefined ? null : rangeFile(first.run.id, first.range, first.recorded);
  }

  /** Requests one run after the other, because the service reads few ranges at a time. */
  private async each<Result>(
    names: readonly string[],
    range: TimeRange,
    { signal, onShare }: Waiting,
    ask: (part: Part, waiting: Waiting) => Promise<Result>,
  ): Promise<[Part, Result][]> {
    const parts = this.parts(names, range);
    const found: [Part, Result][] = [];
    for (const part of parts) {
      const onPartShare = (share: number) => onShare((found.length + share) / parts.length);
      found.push([part, await ask(part, { signal, onShare: onPartShare })]);
    }
    return found;
  }

  private parts(names: readonly string[], { from_s, to_s }: TimeRange): Part[] {
    return this.runs.flatMap((run, of) => {
      const drawn = names.filter((name) => splitName(name).of === of);
      const own = {
        from_s: Math.max(0, from_s - offsetOf(run)),
        to_s: Math.min(to_s - offsetOf(run), lastOf(run)),
      };
      if (drawn.length === 0 || own.to_s < own.from_s) return [];
      return [{ run, drawn, recorded: drawn.map((name) => splitName(name).signal), range: own }];
    });
  }

  private basis(
    { run }: Part,
    { from_s, to_s, samples, missing }: RecordedStatistics | RecordedSpectra,
  ): Basis {
    const offset_s = offsetOf(run);
    return {
      of: this.runs.length > 1 ? fillText(TEXTS.run, { run: run.id }) : "",
      range: { from_s: from_s + offset_s, to_s: to_s + offset_s },
      samples,
      missing,
      bucket_s: null,
    };
  }
}

function offsetOf({ offset_s = 0 }: StoredRun): number {
  return offset_s;
}

/** Time of the last sample on the run's own axis [s]. */
function lastOf({ duration_s }: StoredRun): number {
  return Math.max(0, duration_s - PERIOD_S);
}

function statisticsOf({ signals }: RecordedStatistics, name: string, offset_s: number): Statistics {
  const found = signals[name];
  const number = (value: number | null | undefined) => value ?? Number.NaN;
  return {
    minimum: number(found?.minimum),
    minimum_s: number(found?.minimum_s) + offset_s,
    maximum: number(found?.maximum),
    maximum_s: number(found?.maximum_s) + offset_s,
    mean: number(found?.mean),
    deviation: number(found?.deviation),
    values: found?.values ?? 0,
    withoutValue: found?.without_value ?? 0,
  };
}

function spectrumOf(
  { signals }: RecordedSpectra,
  name: string,
): { spectrum: SignalSpectrum | null; reason: string } {
  const found = signals[name];
  if (found === undefined || found.reason !== "") return { spectrum: null, reason: found?.reason ?? "" };
  const density = Float64Array.from(found.density);
  const spectrum = {
    frequencies: density.map((_, line) => (line + 1) * found.step_Hz),
    density,
    amplitude: density.map((value) => Math.sqrt(2 * value * found.noise_bandwidth_Hz)),
    segments: found.segments,
    segment: found.segment,
    values: found.values,
    withoutValue: found.without_value,
    used: found.used,
  };
  return { spectrum, reason: "" };
}
