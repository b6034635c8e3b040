/** What figures were computed from, in words. Pure. */

import type { Basis } from "../samples/figures";
import { fixed, significant } from "../samples/format";

/** "every sample between 0:00.000 and 9:59.999: 599 988 samples, 12 missing"; of several recordings, of each. */
export function basisWords(basis: readonly Basis[], timeText: (time_s: number) => string): string {
  if (basis.length === 0) return "no sample in this range";
  return basis.map((one) => wordsOf(one, timeText)).join("; ");
}

function wordsOf(
  { of, range, samples, missing, bucket_s }: Basis,
  timeText: (time_s: number) => string,
): string {
  const before = of === "" ? "" : `${of}: `;
  if (range === null) return `${before}no sample in this range`;
  const stretch = `between ${timeText(range.from_s)} and ${timeText(range.to_s)}`;
  if (bucket_s !== null) {
    return `${before}min and max per ${significant(bucket_s, 3)} s ${stretch}: ${grouped(samples)} pairs`;
  }
  const lacking = missing === 0 ? "" : `, ${grouped(missing)} missing`;
  return `${before}every sample ${stretch}: ${grouped(samples)} samples${lacking}`;
}

/** A whole number with its digits in threes. */
export function grouped(count: number): string {
  return fixed(count, 0).replaceAll(/\B(?=(\d{3})+$)/g, "\u202f");
}
