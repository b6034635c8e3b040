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
import { parted } from "./sources";
import { TEXTS } from "./texts";

/** What the service computes from every sample of what is drawn, and the file of it. */

/** Values at one time, by signal; NaN where the sample there has none, and where there is no sample. */
export type Moment = ReadonlyMap<string, number>;

export interface StoredData {
  statistics(names: readonly string[], range: TimeRange, waiting: Waiting): Promise<Figures>;
  spectra(names: readonly string[], range: TimeRange, waiting: Waiting): Promise<Spectra>;
  /** In the order of the times. */
  values(names: readonly string[], times_s: readonly number[], signal: AbortSignal): Promise<Moment[]>;
  /** Address of the file of every sample of a range; null where the range has none. */
  file(names: readonly string[], range: TimeRange): string | null;
  /** What the file is of: "run 12". */
  readonly fileOf: string;
}

/** Values at single moments that only the service has: asked for once the moments have come to rest. */

export class StoredMoments {
  private readonly found = new Map<number, Moment>();
  private wanted = "";
  private asked = "";
  private leave = new AbortController();
  private failed = "";

  constructor(
    private readonly stored: StoredData,
    private readonly names: readonly string[],
  ) {}

  /** Why the values of the moments wanted last are not there; "" where they are, or are on their way. */
  get problem(): string {
    return this.failed;
  }

  /** Called time and again: what is wanted twice in a row is asked for; values of other moments are forgotten. */
  want(times_s: readonly number[]): void {
    const missing = times_s.filter((time_s) => !this.found.has(time_s));
    const key = missing.join(" ");
    const rested = key === this.wanted;
    this.wanted = key;
    if (key === "" || !rested || key === this.asked) return;
    this.asked = key;
    this.failed = "";
    this.leave.abort();
    this.leave = new AbortController();
    const { signal } = this.leave;
    this.stored
      .values(this.names, missing, signal)
      .then((moments) => {
        if (signal.aborted) return;
        for (const known of [...this.found.keys()]) if (!times_s.includes(known)) this.found.delete(known);
        for (const [n, moment] of moments.entries()) this.found.set(missing[n] as number, moment);
        this.asked = "";
      })
      .catch((error: Error) => {
        if (!signal.aborted) this.failed = error.message;
      });
  }

  /** A value in SI, NaN where there is none; null where it is not here. */
  at(name: string, time_s: number): number | null {
    const moment = this.found.get(time_s);
    return moment === undefined ? null : (moment.get(name) ?? Number.NaN);
  }

  /** Ask for nothing any more. */
  close(): void {
    this.leave.abort();
  }
}

/** Recorded runs on one time axis, of which the service computes figures from every sample. Pure but for its requests. */

export interface StoredRun {
  readonly id: number;
  readonly duration_s: number;
  /** What its times are shifted by onto the axis of the charts. */
  readonly offset_s?: number;
}

/** A time on the axis is a sum of others: it may miss the first or the last sample by a rounding. */
const ROUNDING_S = PERIOD_S / 2;

/** A part of what is asked for that is of one run: signals as drawn and as recorded, and the range on its own axis. */
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
        const drawn = names.filter((name) => parted(name).of === of);
        const last_s = lastOf(run);
        const inside = times_s.flatMap((time_s, n) => {
          const own_s = time_s - offsetOf(run);
          const within = own_s > -ROUNDING_S && own_s < last_s + PERIOD_S + ROUNDING_S;
          return within ? [{ n, at_s: Math.min(Math.max(own_s, 0), last_s) }] : [];
        });
        if (drawn.length === 0 || inside.length === 0) return;
        const recorded = drawn.map((name) => parted(name).signal);
        const at = inside.map(({ at_s }) => at_s);
        const found = await valuesAt(run.id, at, recorded, signal);
        found.moments.forEach(({ t, at_s, values }, index) => {
          // an older sample is not of this time: those after it are missing
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

  /** Ask for one run after the other: the service reads few ranges at a time. */
  private async each<Result>(
    names: readonly string[],
    range: TimeRange,
    { signal, onShare }: Waiting,
    ask: (part: Part, waiting: Waiting) => Promise<Result>,
  ): Promise<[Part, Result][]> {
    const parts = this.parts(names, range);
    const found: [Part, Result][] = [];
    for (const part of parts) {
      const hear = (share: number) => onShare((found.length + share) / parts.length);
      found.push([part, await ask(part, { signal, onShare: hear })]);
    }
    return found;
  }

  private parts(names: readonly string[], { from_s, to_s }: TimeRange): Part[] {
    return this.runs.flatMap((run, of) => {
      const drawn = names.filter((name) => parted(name).of === of);
      const own = {
        from_s: Math.max(0, from_s - offsetOf(run)),
        to_s: Math.min(to_s - offsetOf(run), lastOf(run)),
      };
      if (drawn.length === 0 || own.to_s < own.from_s) return [];
      return [{ run, drawn, recorded: drawn.map((name) => parted(name).signal), range: own }];
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
