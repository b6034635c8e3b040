/** Computes statistics and spectra of samples, with what they were computed from. Pure. */

import FFT from "fft.js";
import type { Column, SampleTable, TimeRange } from "./timeSeries";

/** Figures of a signal over the stretch in sight. Pure. */

export interface Statistics {
  readonly minimum: number;
  /** Where it is first: of an envelope, where its bucket begins [s]. */
  readonly minimum_s: number;
  readonly maximum: number;
  readonly maximum_s: number;
  readonly mean: number;
  /** Standard deviation about the mean, divided by the number of values. */
  readonly deviation: number;
  /** Samples, or buckets, that have a value and that have none. */
  readonly values: number;
  readonly withoutValue: number;
}

const NOTHING: Statistics = {
  minimum: Number.NaN,
  minimum_s: Number.NaN,
  maximum: Number.NaN,
  maximum_s: Number.NaN,
  mean: Number.NaN,
  deviation: Number.NaN,
  values: 0,
  withoutValue: 0,
};

/**
 * Statistics of a column over the times of its rows; NaN without any number. Of an envelope (not `raw`) the extremes
 * are exact, and there is no mean or deviation: they need every sample.
 */
export function statistics({ minimum, maximum }: Column, t: ArrayLike<number>, raw: boolean): Statistics {
  let low = Number.POSITIVE_INFINITY;
  let high = Number.NEGATIVE_INFINITY;
  let [lowRow, highRow] = [0, 0];
  let count = 0;
  let mean = 0;
  let squares = 0;
  for (let row = 0; row < minimum.length; row++) {
    const a = minimum[row] as number;
    const b = maximum[row] as number;
    if (Number.isNaN(a) || Number.isNaN(b)) continue;
    if (a < low) [low, lowRow] = [a, row];
    if (b > high) [high, highRow] = [b, row];
    count += 1;
    const shift = a - mean;
    mean += shift / count;
    squares += shift * (a - mean);
  }
  const withoutValue = minimum.length - count;
  if (count === 0) return { ...NOTHING, withoutValue };
  return {
    minimum: low,
    minimum_s: t[lowRow] as number,
    maximum: high,
    maximum_s: t[highRow] as number,
    mean: raw ? mean : Number.NaN,
    deviation: raw ? Math.sqrt(squares / count) : Number.NaN,
    values: count,
    withoutValue,
  };
}

/** Power spectral density and amplitude spectrum of a stretch of samples. Pure. */

export interface Spectrum {
  /** [Hz]; without 0 and half the sampling rate. */
  readonly frequencies: Float64Array;
  /** [unit²/Hz], one-sided. */
  readonly density: Float64Array;
  /** Amplitude of a sine at that frequency [unit]. */
  readonly amplitude: Float64Array;
  readonly segments: number;
}

/** Fewest samples worth a spectrum. */
const LEAST_SAMPLES = 64;
const LONGEST_SEGMENT = 8192;
/** A spectrum of less than four segments scatters too much to be read: half the record is the longest one. */
const SHARE_OF_RECORD = 2;

/**
 * Welch's estimate: Hann windows that overlap by half, mean of each segment removed. Missing samples must not be among
 * `values`. Returns null for less than LEAST_SAMPLES.
 */
export function welch(values: ArrayLike<number>, period_s: number): Spectrum | null {
  if (values.length < LEAST_SAMPLES) return null;
  const length = Math.min(LONGEST_SEGMENT, 2 ** Math.floor(Math.log2(values.length / SHARE_OF_RECORD)));
  const fft = new FFT(length);
  const window = Float64Array.from({ length }, (_, k) => 0.5 - 0.5 * Math.cos((2 * Math.PI * k) / length));
  const sum = window.reduce((total, weight) => total + weight, 0);
  const power = window.reduce((total, weight) => total + weight * weight, 0);
  const bins = length / 2 - 1;
  const squares = new Float64Array(bins);
  const segment = new Array<number>(length);
  const out = fft.createComplexArray();
  let segments = 0;
  for (let start = 0; start + length <= values.length; start += length / 2) {
    let mean = 0;
    for (let k = 0; k < length; k++) mean += (values[start + k] as number) / length;
    for (let k = 0; k < length; k++) {
      segment[k] = ((values[start + k] as number) - mean) * (window[k] as number);
    }
    fft.realTransform(out, segment);
    for (let bin = 1; bin <= bins; bin++) {
      const [re, im] = [out[2 * bin] as number, out[2 * bin + 1] as number];
      squares[bin - 1] = (squares[bin - 1] as number) + re * re + im * im;
    }
    segments += 1;
  }
  const mean = squares.map((square) => square / segments);
  return {
    frequencies: Float64Array.from({ length: bins }, (_, bin) => (bin + 1) / (length * period_s)),
    density: mean.map((square) => (2 * square * period_s) / power),
    amplitude: mean.map((square) => (2 * Math.sqrt(square)) / sum),
    segments,
  };
}

/** The longest stretch without a missing sample. */
export function longestWhole(values: Float64Array): Float64Array {
  let best: [number, number] = [0, 0];
  let from = 0;
  for (let row = 0; row <= values.length; row++) {
    if (row < values.length && !Number.isNaN(values[row])) continue;
    if (row - from > best[1] - best[0]) best = [from, row];
    from = row + 1;
  }
  return values.slice(...best);
}

/** What figures were computed from. */
export interface Basis {
  /** "run 12"; "" where it is the one thing that is drawn. */
  readonly of: string;
  /** First and last sample; null where there is none. */
  readonly range: TimeRange | null;
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
