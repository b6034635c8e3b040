/** A recording on another time axis: shifted onto that of the run that it is compared with. */

import type { Stretch } from "../samples/stretch";
import type { SampleTable } from "../samples/table";
import type { Panel } from "../theme/signals";
import type { Curves, PlotSource } from "./source";

export class ShiftedSource implements PlotSource {
  constructor(
    private readonly own: PlotSource,
    private readonly offset_s: number,
  ) {}

  now_s(): number {
    return this.own.now_s() + this.offset_s;
  }

  newest_s(): number {
    return this.own.newest_s() + this.offset_s;
  }

  first_s(): number {
    return this.own.first_s() + this.offset_s;
  }

  version(): number {
    return this.own.version();
  }

  changedWithin(seen: Stretch, version: number): boolean {
    return this.own.changedWithin(this.back(seen), version);
  }

  curves(panel: Panel, stretch: Stretch, pixels: number): Curves {
    const curves = this.own.curves(panel, this.back(stretch), pixels);
    return { ...curves, times: curves.times.map((time) => time + this.offset_s) };
  }

  /** What is before its begin or after its end it does not know. */
  at(name: string, time_s: number): number {
    return time_s < this.first_s() || time_s > this.now_s()
      ? Number.NaN
      : this.own.at(name, time_s - this.offset_s);
  }

  exactAt(time_s: number): boolean {
    return this.own.exactAt?.(time_s - this.offset_s) ?? true;
  }

  table(names: readonly string[], stretch: Stretch): SampleTable {
    const found = this.own.table(names, this.back(stretch));
    return { ...found, t: found.t.map((time) => time + this.offset_s) };
  }

  private back({ from_s, to_s }: Stretch): Stretch {
    return { from_s: from_s - this.offset_s, to_s: to_s - this.offset_s };
  }
}
