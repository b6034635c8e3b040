/** Statistics and spectra with what they were computed from. Pure. */

import { longestWhole, type Spectrum, welch } from "./spectrum";
import { type Statistics, statistics } from "./statistics";
import type { Stretch } from "./stretch";
import type { SampleTable } from "./table";

/** What figures were computed from. */
export interface Basis {
  /** "run 12"; "" where it is the one thing that is drawn. */
  readonly of: string;
  /** First and last sample; null where there is none. */
  readonly range: Stretch | null;
  readonly samples: number;
  /** Samples that are lacking between the first and the last. */
  readonly missing: number;
  /** Length of the buckets whose extremes are all there is [s]; null where every sample is there. */
  readonly bucket_s: number | null;
}

export interface Figures {
  readonly basis: readonly Basis[];
  readonly signals: ReadonlyMap<string, Statistics>;
}

export interface SignalSpectrum extends Spectrum {
  /** Samples that have a value, that have none, and that lie in a segment. */
  readonly values: number;
  readonly withoutValue: number;
  readonly used: number;
  readonly segment: number;
}

export interface Spectra {
  readonly basis: readonly Basis[];
  readonly signals: ReadonlyMap<string, SignalSpectrum>;
  /** Why a signal has none. */
  readonly reasons: ReadonlyMap<string, string>;
}

/** Statistics of what the page itself holds. */
export function figuresOf(table: SampleTable): Figures {
  const { t, raw, columns } = table;
  return {
    basis: [basisOf(table)],
    signals: new Map(columns.map((column) => [column.name, statistics(column, t, raw)])),
  };
}

/** Spectra of signals that the page itself holds. */
export function spectraOf(table: SampleTable, names: readonly string[], period_s: number): Spectra {
  const signals = new Map<string, SignalSpectrum>();
  const reasons = new Map<string, string>();
  for (const name of names) {
    const column = table.columns.find((one) => one.name === name);
    const whole = longestWhole(column?.minimum ?? new Float64Array(0));
    const spectrum = table.raw ? welch(whole, period_s) : null;
    if (spectrum === null || column === undefined) {
      reasons.set(
        name,
        table.raw ? "fewer than 64 consecutive samples have a value" : "a spectrum needs every sample",
      );
      continue;
    }
    const values = column.minimum.reduce((sum, value) => sum + (Number.isNaN(value) ? 0 : 1), 0);
    const segment = 2 * (spectrum.frequencies.length + 1);
    const used = ((spectrum.segments + 1) * segment) / 2;
    signals.set(name, { ...spectrum, values, withoutValue: column.minimum.length - values, used, segment });
  }
  return { basis: [basisOf(table)], signals, reasons };
}

function basisOf({ t, raw, width_s }: SampleTable): Basis {
  const [first, last] = [t[0], t.at(-1)];
  return {
    of: "",
    range: first === undefined || last === undefined ? null : { from_s: first, to_s: last },
    samples: t.length,
    missing: 0,
    bucket_s: raw ? null : width_s,
  };
}
