/** Computes statistics and spectra of samples, with the data basis of each result. Pure. */

import FFT from "fft.js";
import type { Column, SampleTable, TimeRange } from "./timeSeries";

/** Statistics of a signal over the visible time range. Pure. */

export interface Statistics {
  readonly minimum: number;
  /** Time of the first minimum; for an envelope, the start of its bucket [s]. */
  readonly minimum_s: number;
  readonly maximum: number;
  readonly maximum_s: number;
  readonly mean: number;
  /** Standard deviation about the mean, with division by the number of values. */
  readonly deviation: number;
  /** Number of samples, or of buckets, with and without a value. */
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
 * Statistics of a column over the times of its rows; NaN without any value. For an envelope (not `raw`) the extremes
 * are exact; mean and deviation are NaN, because they need every sample.
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

/** Power spectral density and amplitude spectrum of consecutive samples. Pure. */

export interface Spectrum {
  /** Frequencies [Hz], without 0 and half the sampling rate. */
  readonly frequencies: Float64Array;
  /** One-sided power spectral density [unit²/Hz]. */
  readonly density: Float64Array;
  /** Amplitude of a sine at that frequency [unit]. */
  readonly amplitude: Float64Array;
  readonly segments: number;
}

/** Minimum number of samples for a spectrum. */
const LEAST_SAMPLES = 64;
const LONGEST_SEGMENT = 8192;
/** Divisor of the record length that limits a segment: with fewer segments the estimate scatters too much. */
const SHARE_OF_RECORD = 2;

/**
 * Spectrum by Welch's method: Hann windows with 50 % overlap, mean of each segment removed. `values` must not contain
 * missing samples. Returns null for fewer than LEAST_SAMPLES.
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

/** Returns the longest range of samples without a missing one. */
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

/** Data from which results were computed. */
export interface Basis {
  /** "run 12"; empty if the chart shows only one source. */
  readonly of: string;
  /** Times of the first and last sample; null without samples. */
  readonly range: TimeRange | null;
  readonly samples: number;
  /** Number of missing samples between the first and the last. */
  readonly missing: number;
  /** Length of a bucket of an envelope [s]; null for raw samples. */
  readonly bucket_s: number | null;
}

export interface Figures {
  readonly basis: readonly Basis[];
  readonly signals: ReadonlyMap<string, Statistics>;
}

export interface SignalSpectrum extends Spectrum {
  /** Samples with a value, without a value, and within a segment. */
  readonly values: number;
  readonly withoutValue: number;
  readonly used: number;
  readonly segment: number;
}

export interface Spectra {
  readonly basis: readonly Basis[];
  readonly signals: ReadonlyMap<string, SignalSpectrum>;
  /** Reason why a signal has no spectrum. */
  readonly reasons: ReadonlyMap<string, string>;
}

/** Statistics of samples in the page's memory. */
export function figuresOf(table: SampleTable): Figures {
  const { t, raw, columns } = table;
  return {
    basis: [basisOf(table)],
    signals: new Map(columns.map((column) => [column.name, statistics(column, t, raw)])),
  };
}

/** Spectra of samples in the page's memory. */
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
