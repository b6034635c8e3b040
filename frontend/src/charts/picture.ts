/** A stack of charts as one picture, each under its heading. */

import { dashOf, type Panel } from "../theme/signals";
import type { ChartColours } from "./colours";

const HEADING_PX = 24;
const FOOT_PX = 22;
const INDENT_PX = 12;
const GAP_PX = 14;
const SWATCH_PX = 18;

/** Paint the canvases below each other on the panel's colour, with title, unit and legend of what is shown. */
export function stackPicture(
  panels: readonly Panel[],
  canvases: readonly HTMLCanvasElement[],
  hidden: ReadonlySet<string>,
  colours: ChartColours,
  foot: string,
): HTMLCanvasElement {
  const ratio = devicePixelRatio;
  const picture = document.createElement("canvas");
  picture.width = Math.max(...canvases.map((canvas) => canvas.width));
  picture.height =
    canvases.reduce((sum, canvas) => sum + canvas.height + HEADING_PX * ratio, 0) + FOOT_PX * ratio;
  const pen = picture.getContext("2d");
  if (pen === null) return picture;
  pen.fillStyle = colours.panel;
  pen.fillRect(0, 0, picture.width, picture.height);
  pen.textBaseline = "middle";
  let top = 0;
  for (const [index, canvas] of canvases.entries()) {
    const panel = panels[index] as Panel;
    heading(pen, panel, hidden, colours, top + (HEADING_PX / 2) * ratio, ratio);
    top += HEADING_PX * ratio;
    pen.drawImage(canvas, 0, top);
    top += canvas.height;
  }
  pen.font = `${11 * ratio}px system-ui, sans-serif`;
  pen.fillStyle = colours.axis;
  pen.fillText(foot, INDENT_PX * ratio, top + (FOOT_PX / 2) * ratio);
  return picture;
}

function heading(
  pen: CanvasRenderingContext2D,
  panel: Panel,
  hidden: ReadonlySet<string>,
  colours: ChartColours,
  middle: number,
  ratio: number,
): void {
  pen.font = `600 ${13 * ratio}px system-ui, sans-serif`;
  pen.fillStyle = colours.text;
  const title = `${panel.title} [${panel.unit}]`;
  pen.fillText(title, INDENT_PX * ratio, middle);
  let left = INDENT_PX * ratio + pen.measureText(title).width + GAP_PX * ratio;
  pen.font = `${12 * ratio}px system-ui, sans-serif`;
  for (const trace of panel.traces) {
    if (hidden.has(trace.name)) continue;
    pen.strokeStyle = trace.hue;
    pen.lineWidth = 2.5 * ratio;
    pen.setLineDash(dashOf(trace).map((length) => length * ratio));
    pen.beginPath();
    pen.moveTo(left, middle);
    pen.lineTo(left + SWATCH_PX * ratio, middle);
    pen.stroke();
    left += (SWATCH_PX + 5) * ratio;
    pen.fillText(trace.name, left, middle);
    left += pen.measureText(trace.name).width + GAP_PX * ratio;
  }
}
