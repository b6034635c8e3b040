/** Limit lines and event marks, drawn on a chart's canvas. */

import type uPlot from "uplot";
import type { Panel } from "../theme/signals";
import type { ChartColours } from "./canvas";

export interface LimitLine {
  /** Limited signals; panels with one of them show the line. */
  readonly of: readonly string[];
  /** Value in the unit of the chart. */
  readonly value: number;
  readonly label: string;
  /** Whether the value axis always includes this line. */
  readonly alwaysInSight: boolean;
}

export interface PlacedMark {
  readonly time_s: number;
  readonly text: string;
  readonly fault: boolean;
  /** Whether the mark is a change of the mode, which takes precedence over other marks at that time. */
  readonly mode?: boolean;
}

/** The limit lines of a panel. */
export function linesOf(panel: Panel, limits: readonly LimitLine[]): readonly LimitLine[] {
  return limits.filter(({ of }) => panel.traces.some(({ name }) => of.includes(name)));
}

/** Height above the first chart for the labels of marks [CSS px]. */
export const MARK_LANE_PX = 14;
const FONT_PX = 10;
/** Opacity of the background of a limit's label. */
const LABEL_GROUND = 0.85;
const LABEL_GAP_PX = 8;
/** Text whose width is the minimum width of a label. */
const LEAST_LABEL = "mode ru… +1";

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

/** Draws labels over the curves, on a background, so that they are legible. */
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

/** Height of a limit on the canvas; null outside the visible range. */
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
  for (const mark of inSight) {
    const x = Math.round(plot.valToPos(mark.time_s, "x", true)) + 0.5;
    ctx.strokeStyle = mark.fault ? colours.fault : mark.mode ? colours.axis : colours.limit;
    ctx.setLineDash(mark.fault || mark.mode ? [] : [4 * ratio, 3 * ratio]);
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
  }
  if (labels) drawLabels(plot, inSight, colours);
  ctx.restore();
}

/** Draws the labels of the marks above the chart. */
function drawLabels(plot: uPlot, marks: readonly PlacedMark[], colours: ChartColours): void {
  const { ctx, bbox } = plot;
  const ratio = devicePixelRatio;
  ctx.font = `${FONT_PX * ratio}px system-ui, sans-serif`;
  ctx.textAlign = "left";
  ctx.textBaseline = "bottom";
  const placed = marks.map((mark) => ({ mark, x: plot.valToPos(mark.time_s, "x", true) }));
  const right = bbox.left + bbox.width;
  const labels = labelsOf(placed, right, LABEL_GAP_PX * ratio, (text) => ctx.measureText(text).width);
  for (const { text, x, fault } of labels) {
    ctx.fillStyle = fault ? colours.fault : colours.axis;
    ctx.fillText(text, x, bbox.top - 2 * ratio);
  }
}

interface Label {
  readonly text: string;
  readonly x: number;
  readonly fault: boolean;
}

/**
 * Labels without overlap, from left to right. Marks that are too close share a label: the first fault, otherwise the
 * first change of the mode, otherwise the first mark, with the number of the others: "trip +2". `right` is the right
 * end of the last label.
 */
export function labelsOf(
  placed: readonly { readonly mark: PlacedMark; readonly x: number }[],
  right: number,
  gap: number,
  widthOf: (text: string) => number,
): Label[] {
  const least = widthOf(LEAST_LABEL);
  const groups: { lead: PlacedMark; x: number; count: number }[] = [];
  for (const { mark, x } of [...placed].sort((a, b) => a.x - b.x)) {
    const last = groups.at(-1);
    if (last === undefined || x - last.x >= least + gap) {
      groups.push({ lead: mark, x, count: 1 });
      continue;
    }
    last.count += 1;
    if (rank(mark) > rank(last.lead)) last.lead = mark;
  }
  const more = groups.map(({ count }) => (count > 1 ? ` +${count - 1}` : ""));
  const begins = groups.map(({ x }) => x);
  const last = groups.at(-1);
  if (last !== undefined) {
    // The last label moves to the left as far as the previous one permits.
    const wanted = right - widthOf(last.lead.text + more.at(-1));
    const leftmost = (begins.at(-2) ?? Number.NEGATIVE_INFINITY) + least + gap;
    begins[begins.length - 1] = Math.min(last.x, Math.max(wanted, leftmost));
  }
  return groups.map(({ lead }, index) => {
    const x = begins[index] as number;
    const width = (begins[index + 1] ?? right + gap) - gap - x;
    return { text: cut(lead.text, more[index] as string, width, widthOf), x, fault: lead.fault };
  });
}

function rank({ fault, mode }: PlacedMark): number {
  return fault ? 2 : mode ? 1 : 0;
}

/** A text and its suffix within a width: the text is shortened to fit. */
function cut(text: string, more: string, width: number, widthOf: (text: string) => number): string {
  if (widthOf(text + more) <= width) return text + more;
  let length = text.length;
  while (length > 1 && widthOf(`${text.slice(0, length)}…${more}`) > width) length -= 1;
  return `${text.slice(0, length).trimEnd()}…${more}`;
}

/** The marks within `within_s` of a time, sorted by time. */
export function marksNear(marks: readonly PlacedMark[], at_s: number, within_s: number): PlacedMark[] {
  return marks
    .filter(({ time_s }) => Math.abs(time_s - at_s) <= within_s)
    .sort((a, b) => a.time_s - b.time_s);
}
