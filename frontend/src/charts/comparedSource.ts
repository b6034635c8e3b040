/** Recordings on the same axes: the signals of each after the first carry its mark. Pure but for its sources. */

import type { Extent } from "../samples/decimate";
import type { Stretch } from "../samples/stretch";
import type { SampleTable } from "../samples/table";
import { HUES, type Panel, type Trace } from "../theme/signals";
import type { Curves, PlotSource } from "./source";

const PRIME = "′";
const RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹";
const PRIMES = 3;

/** What the signals of the n-th further recording carry: ′, ″ as ′′, and from the fourth on its number. */
export function markOf(n: number): string {
  if (n <= PRIMES) return PRIME.repeat(n);
  return PRIME + [...String(n)].map((digit) => RAISED[Number(digit)]).join("");
}

/** Dashes and gaps of as many recordings as can be told apart without hues; [6, 4] is that of references [px]. */
const DASHES = [[], [2, 3], [10, 4], [8, 3, 2, 3], [2, 7], [8, 2, 2, 2, 2, 2], [4, 6], [1, 2]] as const;
const DOTTED = DASHES[1];
const LIGHTNESSES = [0.52, 0.7, 0.61] as const;
const CHROMA = 0.13;
const FIRST_HUE_DEG = 250;

/** The hue of the n-th of so many recordings: Okabe and Ito's, or else evenly around in steps of lightness. */
function hueOf(n: number, count: number): string {
  const known = Object.values(HUES);
  if (count <= known.length) return known[n] as string;
  const levels = LIGHTNESSES.length;
  const angle = FIRST_HUE_DEG + (360 * n) / (levels * Math.ceil(count / levels));
  return `oklch(${LIGHTNESSES[n % levels]} ${CHROMA} ${Number((angle % 360).toFixed(1))})`;
}

/**
 * The curve of a signal in the n-th of so many recordings, 0 for the first. Of two the further one is dotted and the
 * hues stay those of the signals; of more the hue is that of the recording, and the two sides of a recording differ by
 * their dashes.
 */
export function traceOf(trace: Trace, n: number, count: number): Trace {
  const named = { ...trace, name: `${trace.name}${markOf(n)}` };
  if (count <= 2) return n === 0 ? named : { ...named, dash: DOTTED };
  const coloured = { ...named, hue: hueOf(n, count), ofRecording: true };
  const place = trace.broad ? n + DASHES.length / 2 : n;
  return trace.dashed ? coloured : { ...coloured, dash: DASHES[place % DASHES.length] ?? DOTTED };
}

/** The panels with the traces of `further` recordings beside those of the first, the narrow over the broad. */
export function comparedPanels(panels: readonly Panel[], further = 1): Panel[] {
  return panels.map((panel) => {
    const traces = Array.from({ length: further + 1 }, (_, n) =>
      panel.traces.filter((trace) => n === 0 || !trace.dashed).map((trace) => traceOf(trace, n, further + 1)),
    ).flat();
    return {
      ...panel,
      traces: [...traces.filter(({ broad }) => broad), ...traces.filter(({ broad }) => !broad)],
    };
  });
}

/** The name of a signal and the recording it is of: 0 for the first. */
export function parted(name: string): { signal: string; of: number } {
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
    return Math.min(...this.sources.map((source) => source.first_s()));
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
    const taken = parts.map(() => 0);
    const drawn = panel.traces.map((trace) => {
      const { of } = parted(trace.name);
      const [part, place] = [parts[of] as Curves, taken[of] as number];
      taken[of] = place + 1;
      return {
        values: resampled(part.times, part.values[place] as Float64Array, times),
        extent: part.extents[place] as Extent,
      };
    });
    return {
      times,
      values: drawn.map(({ values }) => values),
      extents: drawn.map(({ extent }) => extent),
    };
  }

  at(name: string, time_s: number): number {
    const { signal, of } = parted(name);
    return this.sources[of]?.at(signal, time_s) ?? Number.NaN;
  }

  exactAt(time_s: number): boolean {
    return this.sources.every((source) => source.exactAt?.(time_s) ?? true);
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
