/**
 * Decodes samples that the service sends: CSV, and binary curves (a header, then one or two float32 columns per signal).
 * Pure.
 */

import type { components } from "./api.gen";
import { CURVES_HEADER_BYTES as HEADER_BYTES } from "./sample.gen";

const FLOAT_BYTES = 4;

/** Samples, or smallest and largest value per bucket, in SI; NaN where samples are missing. */
export interface Curve {
  readonly minimum: Float32Array;
  /** The same array as `minimum` where buckets are single samples. */
  readonly maximum: Float32Array;
}

export interface Excerpt {
  /** Buckets are single samples. */
  readonly raw: boolean;
  readonly width_s: number;
  /** Where each bucket begins, from the run's first sample [s]. */
  readonly t: Float64Array;
  readonly signals: Readonly<Record<string, Curve>>;
}

/**
 * Decode an answer. The columns are views on the message, nothing is copied.
 *
 * @throws RangeError when the length does not fit the header and the number of signals.
 */
export function decodeCurves(message: ArrayBuffer, names: readonly string[]): Excerpt {
  if (message.byteLength < HEADER_BYTES) {
    throw new RangeError(`curves of ${message.byteLength} bytes lack their ${HEADER_BYTES}-byte header`);
  }
  const header = new DataView(message, 0, HEADER_BYTES);
  const width_s = header.getFloat64(0, true);
  const first = Number(header.getBigUint64(8, true));
  const count = header.getUint32(16, true);
  const perBucket = header.getUint32(20, true);
  const expected = HEADER_BYTES + names.length * perBucket * count * FLOAT_BYTES;
  if (message.byteLength !== expected) {
    throw new RangeError(`curves of ${count} buckets have ${message.byteLength} bytes, not ${expected}`);
  }
  const column = (index: number) =>
    new Float32Array(message, HEADER_BYTES + index * count * FLOAT_BYTES, count);
  const signals = names.map((name, index): [string, Curve] => {
    const minimum = column(index * perBucket);
    return [name, { minimum, maximum: perBucket === 1 ? minimum : column(index * perBucket + 1) }];
  });
  return {
    raw: perBucket === 1,
    width_s,
    t: Float64Array.from({ length: count }, (_, index) => (first + index) * width_s),
    signals: Object.fromEntries(signals),
  };
}

/** The same from an answer in JSON, where nothing but null can say that a sample is missing. */
export function excerptOf({ raw, width_s, t, signals }: components["schemas"]["SamplesView"]): Excerpt {
  const floats = (values: readonly (number | null)[]) =>
    Float32Array.from(values, (value) => value ?? Number.NaN);
  const curves = Object.entries(signals).map(([name, { minimum, maximum }]): [string, Curve] => [
    name,
    { minimum: floats(minimum), maximum: floats(maximum) },
  ]);
  return { raw, width_s, t: Float64Array.from(t), signals: Object.fromEntries(curves) };
}

/** Samples of an exported file. Pure. */

/** By column; comments of the file are passed over. */
export type Columns = Readonly<Record<string, Float64Array>>;

export function fromCsv(text: string): Columns {
  const lines = text.split("\n").filter((line) => line !== "" && !line.startsWith("#"));
  const names = (lines[0] ?? "").split(",");
  const columns = names.map(() => new Float64Array(Math.max(0, lines.length - 1)));
  for (let row = 1; row < lines.length; row += 1) {
    const cells = (lines[row] as string).split(",");
    for (const [place, column] of columns.entries()) column[row - 1] = Number(cells[place]);
  }
  return Object.fromEntries(names.map((name, place) => [name, columns[place] as Float64Array]));
}
