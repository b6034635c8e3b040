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
const LABEL_GAP_PX = 8;
const LABEL_LENGTH = 28;

export function drawLimits(plot: uPlot, limits: readonly LimitLine[], colours: ChartColours): void {
  const { ctx, bbox } = plot;
  const scale = plot.scales.y as uPlot.Scale;
  const ratio = devicePixelRatio;
  ctx.save();
  ctx.strokeStyle = colours.limit;
  ctx.fillStyle = colours.axis;
  ctx.lineWidth = ratio;
  ctx.font = `${FONT_PX * ratio}px system-ui, sans-serif`;
  ctx.textAlign = "right";
  for (const limit of limits) {
    if (limit.value < (scale.min ?? 0) || limit.value > (scale.max ?? 0)) continue;
    const y = Math.round(plot.valToPos(limit.value, "y", true));
    ctx.setLineDash([2 * ratio, 3 * ratio]);
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
    const below = y - bbox.top < 2 * FONT_PX * ratio;
    ctx.textBaseline = below ? "top" : "bottom";
    ctx.fillText(limit.label, bbox.left + bbox.width - 2 * ratio, y + (below ? 3 : -2) * ratio);
  }
  ctx.restore();
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
