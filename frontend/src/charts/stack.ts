/** Several charts on one time axis, redrawn on the browser's own frames and only when there is something to see. */

import { FramePacer } from "../drawing/pacer";
import type { Stretch } from "../samples/timeSeries";
import type { Panel } from "../theme/signals";
import { readColours } from "./colours";
import { type LimitLine, linesOf, type PlacedMark } from "./decorations";
import { AXIS_WIDTH, RIGHT_MARGIN, SignalPlot } from "./plot";
import type { PlotSource } from "./sources";
import { stretch, type Viewport } from "./viewport";

/** A following view is redrawn once it has moved on by a pixel of the screen: in between nothing could be seen. */
const LEAST_SHIFT_PX = 1;

export class ChartStack {
  private readonly plots: readonly SignalPlot[];
  private width = 0;
  private drawn: (Stretch & { version: number }) | null = null;
  private dirty = true;
  private request = 0;
  private readonly pacer = new FramePacer(1);

  constructor(
    private readonly hosts: readonly HTMLElement[],
    private readonly panels: readonly Panel[],
    private readonly source: PlotSource,
    private readonly view: () => Viewport,
    epoch_s: () => number | null,
    private readonly afterFrame: (seen: Stretch) => void,
  ) {
    const colours = readColours(hosts[0] as HTMLElement);
    this.plots = panels.map(
      (panel, index) =>
        new SignalPlot(
          hosts[index] as HTMLElement,
          { panel, timeAxis: index === panels.length - 1, markLabels: index === 0, epoch_s },
          colours,
        ),
    );
    this.resize();
    this.request = requestAnimationFrame(this.frame);
  }

  /** Width of the plotting area [CSS px]. */
  get plotWidth(): number {
    return Math.max(1, this.width - AXIS_WIDTH - RIGHT_MARGIN);
  }

  /** The stretch in sight now. */
  seen(): Stretch {
    return stretch(this.view(), this.source.now_s());
  }

  resize(): void {
    for (const [index, host] of this.hosts.entries()) {
      this.plots[index]?.resize(host.clientWidth, host.clientHeight);
      this.width = host.clientWidth;
    }
    this.dirty = true;
  }

  show(name: string, shown: boolean): void {
    for (const plot of this.plots) plot.show(name, shown);
    this.dirty = true;
  }

  highlight(name: string | null): void {
    for (const [index, plot] of this.plots.entries()) {
      const mine = this.panels[index]?.traces.some((trace) => trace.name === name);
      plot.highlight(mine ? name : null);
    }
    this.dirty = true;
  }

  get canvases(): readonly HTMLCanvasElement[] {
    return this.plots.map((plot) => plot.canvas);
  }

  setLimits(limits: readonly LimitLine[]): void {
    for (const [index, panel] of this.panels.entries()) {
      const plot = this.plots[index];
      if (plot !== undefined) plot.limits = linesOf(panel, limits);
    }
    this.dirty = true;
  }

  setMarks(marks: readonly PlacedMark[]): void {
    for (const plot of this.plots) plot.marks = marks;
    this.dirty = true;
  }

  scaleValues(index: number, factor: number, fraction: number): void {
    this.plots[index]?.scaleValues(factor, fraction);
    this.dirty = true;
  }

  resetValues(): void {
    for (const plot of this.plots) plot.manualRange = null;
    this.dirty = true;
  }

  destroy(): void {
    cancelAnimationFrame(this.request);
    for (const plot of this.plots) plot.destroy();
  }

  private readonly frame = (): void => {
    this.request = requestAnimationFrame(this.frame);
    const seen = this.seen();
    const now_ms = performance.now();
    if (this.pacer.due(now_ms) && this.worthDrawing(seen)) {
      this.pacer.drew(now_ms);
      for (const [index, plot] of this.plots.entries()) {
        plot.draw(this.source.curves(this.panels[index] as Panel, seen, this.plotWidth), seen);
      }
      this.drawn = { ...seen, version: this.source.version() };
      this.dirty = false;
    }
    this.afterFrame(seen);
  };

  private worthDrawing(seen: Stretch): boolean {
    if (this.dirty || this.drawn === null) return true;
    const perPixel_s = (seen.to_s - seen.from_s) / (this.plotWidth * devicePixelRatio);
    const shift_s = Math.max(
      Math.abs(seen.to_s - this.drawn.to_s),
      Math.abs(seen.from_s - this.drawn.from_s),
    );
    if (shift_s >= LEAST_SHIFT_PX * perPixel_s) return true;
    // a view that follows is redrawn when it has moved on by enough; one that is held, when its samples change
    return this.view().end_s !== null && this.source.changedWithin(seen, this.drawn.version);
  }
}
