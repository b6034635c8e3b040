/** Limit lines and event marks, drawn on a chart's canvas. */

import type uPlot from "uplot";
import type { Panel } from "../theme/signals";
import type { ChartColours } from "./colours";

export interface LimitLine {
  /** Signals that it limits: it stands in the panels that show one of them. */
  readonly of: readonly string[];
  /** In the unit of the chart. */
  readonly value: number;
  readonly label: string;
  /** The value axis always reaches this line. */
  readonly alwaysInSight: boolean;
}

export interface PlacedMark {
  readonly time_s: number;
  readonly text: string;
  readonly fault: boolean;
}

/** Those of the lines that belong into a panel. */
export function linesOf(panel: Panel, limits: readonly LimitLine[]): readonly LimitLine[] {
  return limits.filter(({ of }) => panel.traces.some(({ name }) => of.includes(name)));
}

/** Height above the first chart that is kept free for the labels of marks [CSS px]. */
export const MARK_LANE_PX = 14;
const FONT_PX = 10;
/** How much of a curve the ground of a limit's label hides. */
const LABEL_GROUND = 0.85;
const LABEL_GAP_PX = 8;
const LABEL_LENGTH = 28;

export function drawLimits(plot: uPlot, limits: readonly LimitLine[], colours: ChartColours): void {
  const { ctx, bbox } = plot;
  const ratio = devicePixelRatio;
  ctx.save();
  ctx.strokeStyle = colours.limit;
  ctx.lineWidth = ratio;
  ctx.setLineDash([2 * ratio, 3 * ratio]);
  for (const limit of limits) {
    const y = heightOf(plot, limit);
    if (y === null) continue;
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
  }
  ctx.restore();
}

/** Over the curves, on ground of their own: a curve that passes there leaves them legible. */
export function drawLimitLabels(plot: uPlot, limits: readonly LimitLine[], colours: ChartColours): void {
  const { ctx, bbox } = plot;
  const ratio = devicePixelRatio;
  const size = FONT_PX * ratio;
  const right = bbox.left + bbox.width - 2 * ratio;
  ctx.save();
  ctx.font = `${size}px system-ui, sans-serif`;
  ctx.textAlign = "right";
  for (const limit of limits) {
    const y = heightOf(plot, limit);
    if (y === null) continue;
    const below = y - bbox.top < 2 * size;
    const top = below ? y + 3 * ratio : y - 2 * ratio - size;
    const width = ctx.measureText(limit.label).width;
    ctx.globalAlpha = LABEL_GROUND;
    ctx.fillStyle = colours.panel;
    ctx.fillRect(right - width - 2 * ratio, top, width + 4 * ratio, size);
    ctx.globalAlpha = 1;
    ctx.fillStyle = colours.axis;
    ctx.textBaseline = below ? "top" : "bottom";
    ctx.fillText(limit.label, right, y + (below ? 3 : -2) * ratio);
  }
  ctx.restore();
}

/** Where a limit lies on the canvas, null out of sight. */
function heightOf(plot: uPlot, { value }: LimitLine): number | null {
  const { min, max } = plot.scales.y as uPlot.Scale;
  return value < (min ?? 0) || value > (max ?? 0) ? null : Math.round(plot.valToPos(value, "y", true));
}

export function drawMarks(
  plot: uPlot,
  marks: readonly PlacedMark[],
  colours: ChartColours,
  labels: boolean,
): void {
  const { ctx, bbox } = plot;
  const scale = plot.scales.x as uPlot.Scale;
  const ratio = devicePixelRatio;
  const inSight = marks.filter((mark) => mark.time_s >= (scale.min ?? 0) && mark.time_s <= (scale.max ?? 0));
  ctx.save();
  ctx.lineWidth = ratio;
  ctx.setLineDash([]);
  for (const mark of inSight) {
    const x = Math.round(plot.valToPos(mark.time_s, "x", true)) + 0.5;
    ctx.strokeStyle = mark.fault ? colours.fault : colours.limit;
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
  }
  if (labels) drawLabels(plot, inSight, colours);
  ctx.restore();
}

/** Names of the marks above the chart, as many as fit; those of faults come first. */
function drawLabels(plot: uPlot, marks: readonly PlacedMark[], colours: ChartColours): void {
  const { ctx, bbox } = plot;
  const ratio = devicePixelRatio;
  const taken: [left: number, right: number][] = [];
  ctx.font = `${FONT_PX * ratio}px system-ui, sans-serif`;
  ctx.textAlign = "left";
  ctx.textBaseline = "bottom";
  for (const mark of [...marks.filter((one) => one.fault), ...marks.filter((one) => !one.fault)]) {
    const text = mark.text.length > LABEL_LENGTH ? `${mark.text.slice(0, LABEL_LENGTH - 1)}…` : mark.text;
    const width = ctx.measureText(text).width;
    const left = Math.min(plot.valToPos(mark.time_s, "x", true), bbox.left + bbox.width - width);
    const right = left + width + LABEL_GAP_PX * ratio;
    if (taken.some(([from, to]) => left < to && right > from)) continue;
    taken.push([left, right]);
    ctx.fillStyle = mark.fault ? colours.fault : colours.axis;
    ctx.fillText(text, left, bbox.top - 2 * ratio);
  }
}
