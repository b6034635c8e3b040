/** Two recordings on the same axes: the signals of the second carry a prime. Pure but for its sources. */

import type { Stretch } from "../samples/stretch";
import type { SampleTable } from "../samples/table";
import type { Panel, Trace } from "../theme/signals";
import type { Curves, PlotSource } from "./source";

const PRIME = "′";

/** The panels with the traces of the second recording beside those of the first. */
export function comparedPanels(panels: readonly Panel[]): Panel[] {
  return panels.map((panel) => ({
    ...panel,
    traces: [
      ...panel.traces,
      ...panel.traces
        .filter((trace) => !trace.dashed)
        .map((trace): Trace => ({ ...trace, name: `${trace.name}${PRIME}`, dotted: true })),
    ],
  }));
}

export class ComparedSource implements PlotSource {
  constructor(
    private readonly first: PlotSource,
    private readonly second: PlotSource,
  ) {}

  now_s(): number {
    return Math.max(this.first.now_s(), this.second.now_s());
  }

  newest_s(): number {
    return this.now_s();
  }

  first_s(): number {
    return 0;
  }

  version(): number {
    return this.first.version() + this.second.version();
  }

  changedWithin(_seen: Stretch, version: number): boolean {
    return version !== this.version();
  }

  curves(panel: Panel, stretch: Stretch, pixels: number): Curves {
    const own = { ...panel, traces: panel.traces.filter((trace) => !trace.name.endsWith(PRIME)) };
    const others = {
      ...panel,
      traces: panel.traces
        .filter((trace) => trace.name.endsWith(PRIME))
        .map((trace) => ({ ...trace, name: trace.name.slice(0, -1) })),
    };
    const a = this.first.curves(own, stretch, pixels);
    const b = this.second.curves(others, stretch, pixels);
    const times = merged(a.times, b.times);
    return {
      times,
      values: [
        ...a.values.map((values) => resampled(a.times, values, times)),
        ...b.values.map((values) => resampled(b.times, values, times)),
      ],
      extents: [...a.extents, ...b.extents],
    };
  }

  at(name: string, time_s: number): number {
    return name.endsWith(PRIME) ? this.second.at(name.slice(0, -1), time_s) : this.first.at(name, time_s);
  }

  /** Of the first recording only: files and figures of two are taken one by one. */
  table(names: readonly string[], stretch: Stretch): SampleTable {
    return this.first.table(
      names.filter((name) => !name.endsWith(PRIME)),
      stretch,
    );
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
