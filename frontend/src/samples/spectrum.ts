/** Power spectral density and amplitude spectrum of a stretch of samples. Pure. */

import FFT from "fft.js";

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
export const LEAST_SAMPLES = 64;
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
