/** One chart of the stack on uPlot: curves of a panel over a stretch of time, limit lines, event marks. */

import uPlot from "uplot";
import { paintsInSoftware, withMemoryCanvases } from "../drawing/canvas";
import type { Stretch } from "../samples/stretch";
import { dashOf, type Panel } from "../theme/signals";
import type { ChartColours } from "./colours";
import {
  drawLimitLabels,
  drawLimits,
  drawMarks,
  type LimitLine,
  MARK_LANE_PX,
  type PlacedMark,
} from "./decorations";
import { linePath } from "./linePath";
import { steadyRange, type ValueRange } from "./range";
import type { Curves } from "./source";
import { tickLabels } from "./ticks";
import { splitsOf, TIME_STEPS_S, timeText } from "./timeAxis";

export const AXIS_WIDTH = 52;
export const RIGHT_MARGIN = 10;
export const TIME_AXIS_HEIGHT = 24;
const FONT = "11px system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";
const LINE_WIDTH = 1.6;
/** As wide as that the line above it leaves an edge in sight on both sides. */
const BROAD = 3;
/** Lines of one pixel are painted several times faster in software. */
const HAIRLINE = 1;
const LABEL_CLEARANCE_PX = 5;
/** Least height of a value axis scaled by hand, as a share of the usual least: labels stay within their margin. */
const FINEST = 1e-3;

export interface PlotOptions {
  readonly panel: Panel;
  readonly timeAxis: boolean;
  readonly markLabels: boolean;
  /** Time of day at time 0 [s since 1970]; null for an axis that tells the time since the start. */
  epoch_s(): number | null;
}

export class SignalPlot {
  limits: readonly LimitLine[] = [];
  marks: readonly PlacedMark[] = [];
  /** Set when a person scaled the value axis by hand; null lets it follow the curves. */
  manualRange: ValueRange | null = null;

  private readonly plot: uPlot;
  private readonly panel: Panel;
  private range: ValueRange;
  private readonly hidden = new Set<string>();

  constructor(host: HTMLElement, options: PlotOptions, colours: ChartColours) {
    this.panel = options.panel;
    this.range = { min: -options.panel.narrowest / 2, max: options.panel.narrowest / 2 };
    const software = paintsInSoftware();
    const build = () =>
      new uPlot(this.configuration(options, colours, software), [new Float64Array(0)], host);
    this.plot = software ? withMemoryCanvases(build) : build();
  }

  draw(curves: Curves, stretch: Stretch): void {
    const range = this.manualRange ?? this.follow(curves);
    this.plot.batch(() => {
      this.plot.setData([curves.times, ...curves.values] as uPlot.AlignedData, false);
      this.plot.setScale("x", { min: stretch.from_s, max: stretch.to_s });
      this.plot.setScale("y", { ...range });
    });
  }

  resize(width: number, height: number): void {
    if (width > 0 && height > 0) this.plot.setSize({ width, height });
  }

  show(name: string, shown: boolean): void {
    if (shown !== this.hidden.has(name)) return;
    if (shown) this.hidden.delete(name);
    else this.hidden.add(name);
    const index = this.panel.traces.findIndex((trace) => trace.name === name);
    if (index >= 0) this.plot.setSeries(index + 1, { show: shown });
  }

  /** Bring one curve forward by fading the others, or none. */
  highlight(name: string | null): void {
    const index = this.panel.traces.findIndex((trace) => trace.name === name);
    this.plot.setSeries(index < 0 ? (null as unknown as number) : index + 1, { focus: true });
  }

  get canvas(): HTMLCanvasElement {
    return this.plot.ctx.canvas;
  }

  /** Scale the value axis by `factor` about the height `fraction` of it (0 bottom, 1 top). */
  scaleValues(factor: number, fraction: number): void {
    const { min, max } = this.manualRange ?? this.range;
    const fixedPoint = min + fraction * (max - min);
    const least = this.panel.narrowest * FINEST;
    const wanted = Math.max((max - min) * factor, least) / (max - min);
    this.manualRange = {
      min: fixedPoint - (fixedPoint - min) * wanted,
      max: fixedPoint + (max - fixedPoint) * wanted,
    };
  }

  destroy(): void {
    this.plot.destroy();
  }

  private follow(curves: Curves): ValueRange {
    let minimum = Number.POSITIVE_INFINITY;
    let maximum = Number.NEGATIVE_INFINITY;
    for (const [index, extent] of curves.extents.entries()) {
      if (this.hidden.has(this.panel.traces[index]?.name ?? "")) continue;
      minimum = Math.min(minimum, extent.minimum);
      maximum = Math.max(maximum, extent.maximum);
    }
    for (const line of this.limits) {
      if (!line.alwaysInSight) continue;
      minimum = Math.min(minimum, line.value);
      maximum = Math.max(maximum, line.value);
    }
    this.range = steadyRange(this.range, { minimum, maximum }, this.panel.narrowest);
    return this.range;
  }

  private configuration(options: PlotOptions, colours: ChartColours, software: boolean): uPlot.Options {
    const grid = { stroke: () => colours.grid, width: 1 };
    return {
      width: 320,
      height: 120,
      padding: [options.markLabels ? MARK_LANE_PX : 4, RIGHT_MARGIN, options.timeAxis ? 0 : 4, 0],
      legend: { show: false },
      cursor: { show: false, focus: { prox: -1 } },
      focus: { alpha: 0.2 },
      scales: {
        x: { time: false, auto: false, range: asAsked },
        // asked for nothing (a curve was switched on or off), uPlot would leave the axis empty
        y: {
          auto: false,
          range: (_plot, min, max) => (min === null ? [this.range.min, this.range.max] : [min, max]),
        },
      },
      series: [
        {},
        ...options.panel.traces.map(
          (trace): uPlot.Series => ({
            scale: "y",
            auto: false,
            stroke: colours.drawn(trace.hue),
            width: (software ? HAIRLINE : LINE_WIDTH) * (trace.broad ? BROAD : 1),
            dash: dashOf(trace),
            paths: linePath,
            pxAlign: 0,
            points: {
              show: (plot, _series, first, last) => last - first < plot.bbox.width / 10,
              size: 4,
              fill: colours.drawn(trace.hue),
            },
          }),
        ),
      ],
      axes: [
        {
          stroke: () => colours.axis,
          font: FONT,
          grid,
          ticks: { show: false },
          incrs: TIME_STEPS_S,
          space: 70,
          gap: 6,
          size: options.timeAxis ? TIME_AXIS_HEIGHT : 0,
          splits: (_plot, _axis, min, max, step) => splitsOf(min, max, step, options.epoch_s()),
          values: (_plot, splits, _axis, _space, step) =>
            splits.map((split) => (options.timeAxis ? timeText(split, step, options.epoch_s()) : "")),
        },
        {
          scale: "y",
          stroke: () => colours.axis,
          font: FONT,
          grid,
          ticks: { show: false },
          space: 20,
          gap: 6,
          size: AXIS_WIDTH,
          values: (plot, splits, _axis, _space, step) => clearOfHead(plot, splits, tickLabels(splits, step)),
        },
      ],
      hooks: {
        drawAxes: [(plot) => drawLimits(plot, this.limits, colours)],
        draw: [
          (plot) => drawLimitLabels(plot, this.limits, colours),
          (plot) => drawMarks(plot, this.marks, colours, options.markLabels),
        ],
      },
    };
  }
}

/** uPlot ranges scales itself while there are no data; here they are always as asked. */
function asAsked(_plot: uPlot, min: number | null, max: number | null): uPlot.Range.MinMax {
  return [min, max];
}

/** No label at the very top, where it would run into the head of the chart. */
function clearOfHead(plot: uPlot, splits: readonly number[], labels: readonly string[]): string[] {
  return labels.map((label, index) =>
    plot.valToPos(splits[index] as number, "y") < LABEL_CLEARANCE_PX ? "" : label,
  );
}
