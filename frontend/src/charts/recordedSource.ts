/** A stored run as a source of curves: an overview of all of it, and detail where the view has come to rest. */

import { atOrBefore, pointTimes, pointValues } from "../samples/envelope";
import type { Stretch } from "../samples/stretch";
import type { SampleTable } from "../samples/table";
import type { Panel } from "../theme/signals";
import type { Excerpt } from "../wire/curves";
import type { Curves, Pairs, PlotSource } from "./source";

interface Sheet {
  readonly stretch: Stretch;
  readonly samples: Excerpt;
  readonly times: Float64Array;
}

export class RecordedSource implements PlotSource {
  private overview: Sheet | null = null;
  private detail: Sheet | null = null;
  private sheets = 0;

  constructor(private readonly duration_s: number) {}

  setOverview(samples: Excerpt): void {
    this.overview = sheet({ from_s: 0, to_s: this.duration_s }, samples);
    this.sheets += 1;
  }

  setDetail(stretch: Stretch, samples: Excerpt): void {
    this.detail = sheet(stretch, samples);
    this.sheets += 1;
  }

  now_s(): number {
    return this.duration_s;
  }

  newest_s(): number {
    return this.duration_s;
  }

  first_s(): number {
    return 0;
  }

  version(): number {
    return this.sheets;
  }

  changedWithin(_seen: Stretch, version: number): boolean {
    return version !== this.sheets;
  }

  curves(panel: Panel, stretch: Stretch): Curves {
    const chosen = this.covering(stretch);
    if (chosen === null) {
      const nothing = new Float64Array(0);
      const empty = { minimum: Number.POSITIVE_INFINITY, maximum: Number.NEGATIVE_INFINITY };
      return {
        times: nothing,
        values: panel.traces.map(() => nothing),
        extents: panel.traces.map(() => empty),
      };
    }
    const points = panel.traces.map((trace) => pointValues(chosen.samples, trace.name, panel.factor));
    return {
      times: chosen.times,
      values: points.map((point) => point.values),
      extents: points.map((point) => point.extent),
    };
  }

  at(name: string, time_s: number): number {
    const chosen = this.covering({ from_s: time_s, to_s: time_s });
    if (chosen === null || chosen.samples.t.length === 0) return Number.NaN;
    const index = atOrBefore(chosen.samples.t, time_s);
    if (index < 0) return Number.NaN;
    const signal = chosen.samples.signals[name];
    const minimum = signal?.minimum[index] ?? Number.NaN;
    const maximum = signal?.maximum[index] ?? Number.NaN;
    return (minimum + maximum) / 2;
  }

  exactAt(time_s: number): boolean {
    return this.covering({ from_s: time_s, to_s: time_s })?.samples.raw ?? true;
  }

  pairs(x: string, y: string, seen: Stretch): Pairs {
    const { columns } = this.table([x, y], seen);
    const middles = (index: number) => {
      const column = columns[index];
      if (column === undefined) return new Float64Array(0);
      return column.minimum.map((low, row) => (low + (column.maximum[row] as number)) / 2);
    };
    return { x: middles(0), y: middles(1) };
  }

  table(names: readonly string[], seen: Stretch): SampleTable {
    const chosen = this.covering(seen);
    if (chosen === null) return { raw: false, width_s: Number.NaN, t: new Float64Array(0), columns: [] };
    const { t, raw, width_s, signals } = chosen.samples;
    const inside = t.map((_, row) => row).filter((row) => within(t[row] as number, seen));
    const values = (series: Float32Array | undefined) =>
      Float64Array.from(inside, (row) => series?.[row] ?? Number.NaN);
    return {
      raw,
      width_s,
      t: Float64Array.from(inside, (row) => t[row] as number),
      columns: names.map((name) => ({
        name,
        minimum: values(signals[name]?.minimum),
        maximum: values(signals[name]?.maximum),
      })),
    };
  }

  private covering(stretch: Stretch): Sheet | null {
    const detail = this.detail;
    const fits =
      detail !== null && detail.stretch.from_s <= stretch.from_s && detail.stretch.to_s >= stretch.to_s;
    return fits ? detail : this.overview;
  }
}

function within(t: number, { from_s, to_s }: Stretch): boolean {
  return t >= from_s && t <= to_s;
}

function sheet(stretch: Stretch, samples: Excerpt): Sheet {
  return { stretch, samples, times: pointTimes(samples) };
}
