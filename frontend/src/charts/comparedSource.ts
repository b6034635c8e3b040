/** Recordings on the same axes: the signals of each after the first carry its mark. Pure but for its sources. */

import type { Stretch } from "../samples/stretch";
import type { SampleTable } from "../samples/table";
import { PALETTE, type Panel, type Trace } from "../theme/signals";
import type { Curves, PlotSource } from "./source";

const PRIME = "′";
const RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹";
const PRIMES = 3;

/** What the signals of the n-th further recording carry: ′, ″ as ′′, and from the fourth on its number. */
export function markOf(n: number): string {
  if (n <= PRIMES) return PRIME.repeat(n);
  return PRIME + [...String(n)].map((digit) => RAISED[Number(digit)]).join("");
}

/** The hue of the n-th of several further recordings; a single one shares the hues of the first, dotted. */
export function hueOf(n: number): string {
  return PALETTE[n % PALETTE.length] as string;
}

/** The panels with the traces of `count` further recordings beside those of the first. */
export function comparedPanels(panels: readonly Panel[], count = 1): Panel[] {
  const numbers = Array.from({ length: count }, (_, index) => index + 1);
  return panels.map((panel) => {
    const measured = panel.traces.filter((trace) => !trace.dashed);
    const others = numbers.flatMap((n) =>
      measured.map(
        (trace, place): Trace => ({
          ...trace,
          name: `${trace.name}${markOf(n)}`,
          ...(count === 1 ? { dotted: true } : { hue: hueOf(n), dotted: place > 0 }),
        }),
      ),
    );
    return { ...panel, traces: [...panel.traces, ...others] };
  });
}

/** The name of a signal and the recording it is of: 0 for the first. */
function parted(name: string): { signal: string; of: number } {
  const at = name.indexOf(PRIME);
  if (at < 0) return { signal: name, of: 0 };
  const mark = name.slice(at);
  const digits = [...mark].map((letter) => RAISED.indexOf(letter)).filter((digit) => digit >= 0);
  return { signal: name.slice(0, at), of: digits.length > 0 ? Number(digits.join("")) : mark.length };
}

export class ComparedSource implements PlotSource {
  private readonly sources: readonly PlotSource[];

  constructor(...sources: readonly PlotSource[]) {
    this.sources = sources;
  }

  now_s(): number {
    return Math.max(...this.sources.map((source) => source.now_s()));
  }

  newest_s(): number {
    return this.now_s();
  }

  first_s(): number {
    return 0;
  }

  version(): number {
    return this.sources.reduce((sum, source) => sum + source.version(), 0);
  }

  changedWithin(_seen: Stretch, version: number): boolean {
    return version !== this.version();
  }

  curves(panel: Panel, stretch: Stretch, pixels: number): Curves {
    const parts = this.sources.map((source, index) => {
      const traces = panel.traces
        .filter((trace) => parted(trace.name).of === index)
        .map((trace) => ({ ...trace, name: parted(trace.name).signal }));
      return source.curves({ ...panel, traces }, stretch, pixels);
    });
    const times = parts.map((part) => part.times).reduce(merged);
    return {
      times,
      values: parts.flatMap((part) => part.values.map((values) => resampled(part.times, values, times))),
      extents: parts.flatMap((part) => part.extents),
    };
  }

  at(name: string, time_s: number): number {
    const { signal, of } = parted(name);
    return this.sources[of]?.at(signal, time_s) ?? Number.NaN;
  }

  /** Of the first recording only: files and figures of several are taken one by one. */
  table(names: readonly string[], stretch: Stretch): SampleTable {
    const own = names.filter((name) => parted(name).of === 0);
    return (this.sources[0] as PlotSource).table(own, stretch);
  }
}

/** Both ascending rows of times as one. */
export function merged(a: Float64Array, b: Float64Array): Float64Array {
  const both = new Float64Array(a.length + b.length);
  let [i, j, count] = [0, 0, 0];
  while (i < a.length || j < b.length) {
    const next = Math.min(a[i] ?? Number.POSITIVE_INFINITY, b[j] ?? Number.POSITIVE_INFINITY);
    if (a[i] === next) i += 1;
    if (b[j] === next) j += 1;
    both[count] = next;
    count += 1;
  }
  return both.subarray(0, count);
}

/** Values on a denser row of times, each as it was last; NaN outside their own times. */
export function resampled(from: Float64Array, values: Float64Array, to: Float64Array): Float64Array {
  let index = -1;
  const last = from.at(-1) ?? Number.NEGATIVE_INFINITY;
  return to.map((time) => {
    while (index + 1 < from.length && (from[index + 1] as number) <= time) index += 1;
    return index < 0 || time > last ? Number.NaN : (values[index] as number);
  });
}
