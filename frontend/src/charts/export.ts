import { useState } from "react";
import { statistics } from "../samples/analysis";
import { dateTime, fixed, short } from "../samples/format";
import { fillText } from "../samples/texts";
import { type SampleTable, type TimeRange, toCsv } from "../samples/timeSeries";
import { dashOf, type Panel, type Trace, unitOf } from "../theme/signals";
import { answered, api, RequestError } from "../wire/client";
import { printedTime, roundedRange, splitsOf, stepFor, timeText, timeTitle, type ValueRange } from "./axes";
import { type LimitLine, linesOf, type PlacedMark } from "./decorations";
import { type DrawnPlane, drawnNow, extentOf, gridOf, type Plane } from "./PlaneFigure";
import { withShortPaths } from "./plot";
import type { PlotSource } from "./sources";
import type { StoredData } from "./storedRuns";
import { TEXTS } from "./texts";

/** Exports the charts as a vector drawing in print size, with axes, values and origin. Pure. */

/** Width in print and in drawing units; text has the size of a caption. */
const WIDTH_MM = 180;
const WIDTH = 900;
const LEFT = 70;
const RIGHT = 20;
const HEADING = 26;
const PANEL = 130;
const PLANE = 320;
const GAP = 14;
const VALUES = 26;
const TIME_AXIS = VALUES + 18;
const MARGIN = 16;
const FOOT_LINE = 18;
const LABEL_SPACE = { x: 90, y: 30 } as const;
/** Points of a curve: at 300 dpi, 180 mm are one and a half pixels per point. */
const POINTS = 1400;
const GRID = "#d9dde2";
const INK = "#1b1f24";
const PALE = "#59616b";
const FAULT = "#b3261e";

interface Sheet {
  readonly panels: readonly Panel[];
  readonly planes: readonly { readonly plane: Plane; readonly drawn: DrawnPlane }[];
  readonly hidden: ReadonlySet<string>;
  readonly source: PlotSource;
  readonly seen: TimeRange;
  readonly limits: readonly LimitLine[];
  readonly marks: readonly PlacedMark[];
  readonly epoch_s: number | null;
  /** Lines below the charts: origin, tuning and time. */
  readonly foot: readonly string[];
}

interface Box {
  readonly left: number;
  readonly top: number;
  readonly width: number;
  readonly height: number;
}

function heightOf({ panels, planes, foot }: Sheet): number {
  const timed = panels.reduce((sum, { share = 1 }) => sum + HEADING + PANEL * share + GAP, 0);
  return (
    2 * MARGIN +
    timed +
    TIME_AXIS +
    planes.length * (HEADING + PLANE + VALUES + GAP) +
    foot.length * FOOT_LINE
  );
}

/** Returns the drawing as SVG. */
function svgOf(sheet: Sheet): string {
  const { panels, planes, seen, epoch_s, foot } = sheet;
  const height = heightOf(sheet);
  const parts: string[] = [];
  let top = MARGIN;
  for (const [index, panel] of panels.entries()) {
    const box = {
      left: LEFT,
      top: top + HEADING,
      width: WIDTH - LEFT - RIGHT,
      height: PANEL * (panel.share ?? 1),
    };
    parts.push(
      `<g data-panel="${escaped(panel.title)}">`,
      ...timedPanel(sheet, panel, box, index === 0),
      "</g>",
    );
    top = box.top + box.height + GAP;
    if (index < panels.length - 1) continue;
    const at = (time_s: number) => LEFT + ((time_s - seen.from_s) / (seen.to_s - seen.from_s)) * box.width;
    const step = stepFor(seen.to_s - seen.from_s, box.width, LABEL_SPACE.x);
    for (const split of splitsOf(seen.from_s, seen.to_s, step, epoch_s))
      parts.push(
        text(at(split), box.top + box.height + 18, printedTime(split, step, epoch_s), PALE, "middle"),
      );
    parts.push(
      text(LEFT + box.width / 2, box.top + box.height + VALUES + 10, timeTitle(epoch_s), PALE, "middle"),
    );
  }
  top += TIME_AXIS;
  for (const { plane, drawn } of planes) {
    const box = { left: LEFT, top: top + HEADING, width: WIDTH - LEFT - RIGHT, height: PLANE };
    parts.push(`<g data-panel="${escaped(plane.title)}">`, ...planePanel(plane, drawn, box), "</g>");
    top = box.top + box.height + VALUES + GAP;
  }
  for (const [line, words] of foot.entries())
    parts.push(text(MARGIN, top + (line + 0.6) * FOOT_LINE, words, PALE, "start", 'data-role="foot"'));
  const size = `width="${WIDTH_MM}mm" height="${round((height * WIDTH_MM) / WIDTH)}mm"`;
  return [
    `<svg xmlns="http://www.w3.org/2000/svg" ${size} viewBox="0 0 ${WIDTH} ${round(height)}"`,
    ` font-family="Helvetica, Arial, sans-serif" font-size="13">`,
    `<title>${escaped(foot[0] ?? "")}</title>`,
    `<rect width="${WIDTH}" height="${round(height)}" fill="#ffffff"/>`,
    ...parts,
    "</svg>\n",
  ].join("");
}

function timedPanel(sheet: Sheet, panel: Panel, box: Box, labels: boolean): string[] {
  const { source, seen, hidden } = sheet;
  const shown = { ...panel, traces: panel.traces.filter(({ name }) => !hidden.has(name)) };
  const { times, values } = source.curves(shown, seen, POINTS);
  const inside = (_: number, row: number) =>
    (times[row] as number) >= seen.from_s && (times[row] as number) <= seen.to_s;
  const t = times.filter(inside);
  const columns = values.map((column) => column.filter(inside));
  const lines = linesOf(panel, sheet.limits);
  const reach = lines.filter(({ alwaysInSight }) => alwaysInSight).map(({ value }) => value);
  const y = roundedRange(extentOf([...columns, reach]), panel.narrowest);
  const x = { min: seen.from_s, max: seen.to_s };
  const curves = shown.traces.map((trace, n) => curve(trace, t, columns[n] as Float64Array, x, y, box));
  return [
    ...heading(shown, box, columns),
    ...valueAxis(y, box),
    ...lines.filter(({ value }) => value >= y.min && value <= y.max).map((line) => limitLine(line, y, box)),
    ...sheet.marks
      .filter(({ time_s }) => time_s >= seen.from_s && time_s <= seen.to_s)
      .map((mark) => markLine(mark, x, box, labels)),
    ...curves,
  ];
}

function planePanel(plane: Plane, drawn: DrawnPlane, box: Box): string[] {
  const { x, y } = drawn.ranges;
  const grid = gridOf(x, box.width, LABEL_SPACE.x).flatMap(([value, label]) => {
    const at = place(value, x, box.left, box.width);
    const line = `<path d="M${round(at)} ${box.top}v${box.height}" stroke="${GRID}"/>`;
    return [line, text(at, box.top + box.height + 18, label, PALE, "middle")];
  });
  const unit = plane.over.unit === "1" ? "" : ` [${plane.over.unit}]`;
  const over = text(
    box.left + box.width,
    box.top + box.height - 6,
    fillText(TEXTS.overSignal, { signal: plane.over.name, unit }),
    PALE,
    "end",
  );
  const curves = drawn.traces.map((trace, n) => {
    const pairs = drawn.curves[n] as DrawnPlane["curves"][number];
    return curve(trace, pairs.x, pairs.y, x, y, box);
  });
  const shown = { ...plane, traces: drawn.traces };
  return [
    ...heading(
      shown,
      box,
      drawn.curves.map((pairs) => pairs.y),
    ),
    ...valueAxis(y, box),
    ...grid,
    over,
    ...curves,
  ];
}

/** Title and unit, and for each signal its line, its name and its visible range. */
function heading(panel: Panel, box: Box, columns: readonly ArrayLike<number>[]): string[] {
  const middle = box.top - 10;
  const unit = panel.unit === "1" ? "" : ` [${panel.unit}]`;
  const parts = [
    `<text x="${box.left}" y="${middle}" fill="${INK}" font-weight="600">${escaped(panel.title + unit)}</text>`,
  ];
  let right = box.left + box.width;
  for (const [index, trace] of [...panel.traces.entries()].reverse()) {
    const { minimum, maximum } = extentOf([columns[index] as ArrayLike<number>]);
    const range =
      maximum < minimum
        ? TEXTS.noValue
        : fillText(TEXTS.range, {
            from: fixed(minimum, panel.decimals),
            to: fixed(maximum, panel.decimals),
          });
    const words = `${trace.name.replace(" - ", " − ")}  ${range}`;
    const signal = `data-signal="${escaped(trace.name)}"`;
    parts.push(text(right, middle, words, INK, "end", signal));
    const from = right - 7 * words.length - 26;
    parts.push(
      `<path d="M${round(from)} ${middle - 4}h20" stroke="${trace.hue}" stroke-width="2.5"${dashes(trace)}/>`,
    );
    right = from - 14;
  }
  return parts;
}

function valueAxis(y: ValueRange, box: Box): string[] {
  const lines = gridOf(y, box.height, LABEL_SPACE.y).flatMap(([value, label]) => {
    const at = box.top + box.height - place(value, y, 0, box.height);
    return [
      `<path d="M${box.left} ${round(at)}h${box.width}" stroke="${GRID}"/>`,
      text(box.left - 8, at + 4, label, PALE, "end"),
    ];
  });
  const frame = `<rect x="${box.left}" y="${box.top}" width="${box.width}" height="${box.height}" fill="none" stroke="${GRID}"/>`;
  return [...lines, frame];
}

function curve(
  trace: Trace,
  xs: ArrayLike<number>,
  ys: ArrayLike<number>,
  x: ValueRange,
  y: ValueRange,
  box: Box,
): string {
  let path = "";
  let down = false;
  for (let row = 0; row < xs.length; row++) {
    const [a, b] = [xs[row] as number, ys[row] as number];
    const there = Number.isFinite(a) && Number.isFinite(b);
    if (there) {
      const at = `${round(place(a, x, box.left, box.width))} ${round(box.top + box.height - place(b, y, 0, box.height))}`;
      path += `${down ? "L" : "M"}${at}`;
    }
    down = there;
  }
  const axes = `data-x="${x.min} ${x.max}" data-y="${y.min} ${y.max}" data-box="${box.left} ${box.top} ${box.width} ${box.height}"`;
  const width = trace.broad ? 3.2 : 1.4;
  return `<path data-curve="${escaped(trace.name)}" ${axes} d="${path}" fill="none" stroke="${trace.hue}" stroke-width="${width}" stroke-linejoin="round"${dashes(trace)}/>`;
}

function limitLine({ value, label }: LimitLine, y: ValueRange, box: Box): string {
  const at = box.top + box.height - place(value, y, 0, box.height);
  const line = `<path d="M${box.left} ${round(at)}h${box.width}" stroke="${PALE}" stroke-dasharray="2 3"/>`;
  return line + text(box.left + box.width - 4, at < box.top + 16 ? at + 12 : at - 4, label, PALE, "end");
}

function markLine(mark: PlacedMark, x: ValueRange, box: Box, label: boolean): string {
  const at = place(mark.time_s, x, box.left, box.width);
  const colour = mark.fault ? FAULT : PALE;
  const line = `<path d="M${round(at)} ${box.top}v${box.height}" stroke="${colour}" stroke-width="0.8"/>`;
  // The mark's text is a tooltip, because printed texts would overlap.
  return label ? `<g><title>${escaped(mark.text)}</title>${line}</g>` : line;
}

function place(value: number, { min, max }: ValueRange, from: number, length: number): number {
  return from + ((value - min) / (max - min)) * length;
}

function text(x: number, y: number, words: string, fill: string, anchor: string, more = ""): string {
  return `<text x="${round(x)}" y="${round(y)}" fill="${fill}" text-anchor="${anchor}" xml:space="preserve" ${more}>${escaped(words)}</text>`;
}

function dashes(trace: Trace): string {
  const lengths = dashOf(trace);
  return lengths.length > 0 ? ` stroke-dasharray="${lengths.join(" ")}"` : "";
}

function round(value: number): number {
  return Number(value.toFixed(2));
}

function escaped(words: string): string {
  return words.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll('"', "&quot;");
}

/** Saves files through the browser, and converts drawings to pictures. */

/** Kind of a picture: SVG, PDF with embedded fonts, or PNG at print resolution. */
export type PictureKind = "svg" | "pdf" | "png";

function save(content: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  // The download has begun when this task ends.
  setTimeout(() => URL.revokeObjectURL(link.href));
}

/** Downloads a file of the service under the service's name; the page does not buffer it. */
function saveFrom(address: string): void {
  const link = document.createElement("a");
  link.href = address;
  link.download = "";
  link.click();
}

/** A time as part of a file name, in the person's time zone: 2026-03-01-14-05-09. */
function stamp(when: Date): string {
  const parts = [
    when.getMonth() + 1,
    when.getDate(),
    when.getHours(),
    when.getMinutes(),
    when.getSeconds(),
  ].map((part) => String(part).padStart(2, "0"));
  return [when.getFullYear(), ...parts].join("-");
}

/** Print resolution, in dots per inch. */
const DPI = 300;

const MM_PER_INCH = 25.4;

/** Converts a drawing to a PNG of a width in millimetres. Rejects if the browser cannot draw it. */
async function pngOf(svg: string, width_mm: number): Promise<Blob> {
  const image = new Image();
  const address = URL.createObjectURL(new Blob([svg], { type: "image/svg+xml" }));
  try {
    image.src = address;
    await image.decode();
    const canvas = document.createElement("canvas");
    canvas.width = Math.round((width_mm / MM_PER_INCH) * DPI);
    canvas.height = Math.round((canvas.width * image.height) / image.width);
    canvas.getContext("2d")?.drawImage(image, 0, 0, canvas.width, canvas.height);
    return await new Promise((resolve, reject) => {
      canvas.toBlob((content) => (content === null ? reject(new Error(TEXTS.noPicture)) : resolve(content)));
    });
  } finally {
    URL.revokeObjectURL(address);
  }
}

/** Converts a drawing to a file. Rejects with a message for the person on failure. */
export async function picture(svg: string, kind: PictureKind): Promise<Blob> {
  const plain = withPlainColours(svg);
  if (kind === "pdf") return await pdfOf(plain);
  return kind === "svg" ? new Blob([plain], { type: "image/svg+xml" }) : await pngOf(plain, WIDTH_MM);
}

/** PDF of a drawing in its size, which the service creates. Throws Error with a message for the person. */
async function pdfOf(svg: string): Promise<Blob> {
  const body = { svg: withShortPaths(svg) };
  try {
    return await answered(api.POST("/api/chart-sheet.pdf", { body, parseAs: "blob" }));
  } catch (error) {
    const status = error instanceof RequestError ? error.status : null;
    if (status === 413) throw new Error(TEXTS.tooLarge);
    // The service limits the time for a request body; a slow connection ends without a response.
    throw status === 0 || status === 408 ? new Error(TEXTS.notSent) : error;
  }
}

/** Replaces colours that only browsers support with their RGB values. */
function withPlainColours(svg: string): string {
  return svg.replaceAll(/oklch\([^)]*\)/g, shown);
}

function shown(colour: string): string {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("2d");
  if (context === null) return colour;
  context.fillStyle = colour;
  context.fillRect(0, 0, 1, 1);
  const parts = [...context.getImageData(0, 0, 1, 1).data.subarray(0, 3)];
  return `#${parts.map((part) => part.toString(16).padStart(2, "0")).join("")}`;
}

/** Saves a picture of the charts, and their data. */

interface Saving {
  /** First part of file names. */
  readonly name: string;
  readonly names: readonly string[];
  readonly stored: StoredData | null;
  sheet(): Sheet;
  /** The visible range, or the range between the cursors. */
  range(): TimeRange;
  table(): SampleTable;
}

export function useSaving({ name, names, stored, sheet, range, table }: Saving) {
  const [unsaved, setUnsaved] = useState<string | null>(null);

  async function savePicture(kind: PictureKind): Promise<void> {
    try {
      save(await picture(svgOf(sheet()), kind), `${name}-${stamp(new Date())}.${kind}`);
      setUnsaved(null);
    } catch (error) {
      setUnsaved(fillText(TEXTS.pictureNotSaved, { reason: (error as Error).message }));
    }
  }

  /** The service writes every sample of a recording; without one, the page writes its own samples. */
  function saveData(): void {
    setUnsaved(null);
    if (stored === null) {
      const content = toCsv(table(), unitOf);
      save(new Blob([content], { type: "text/csv" }), `${name}-${stamp(new Date())}.csv`);
      return;
    }
    const file = stored.file(names, range());
    if (file === null) setUnsaved(fillText(TEXTS.dataNotSaved, { recording: stored.fileOf }));
    else saveFrom(file);
  }

  return { savePicture, saveData, unsaved };
}

/** Origin of a picture: run, plant, tuning and time. Pure except for the clock. */

export interface Origin {
  /** "run 12", or another source. */
  readonly of: string;
  /** SIM, RIG, or another plant; empty for differences between runs, which have no single tuning. */
  readonly plant: string;
  readonly bank: string;
}

const TUNING = { lam_q: "λ_q", lam_S: "λ_S" } as const;

interface Drawn extends Omit<Sheet, "planes" | "foot"> {
  readonly planes: readonly Plane[];
  readonly readout_s: number;
}

/** Contents of an exported drawing of the current charts. */
export function sheetNow({ planes, readout_s, ...drawn }: Drawn, { of, plant, bank }: Origin): Sheet {
  const { source, hidden, seen, epoch_s } = drawn;
  const [from, to] = [seen.from_s, seen.to_s].map((time_s) => timeText(time_s, 0.001, epoch_s));
  const times = { from: String(from), to: String(to), time: dateTime(new Date().toISOString()) };
  return {
    ...drawn,
    planes: planes.map((plane) => ({ plane, drawn: drawnNow(plane, source, hidden, seen, readout_s, null) })),
    foot: [
      [of, plant, ...(plant === "" ? [] : lambdas(source, seen)), bank]
        .filter((part) => part !== "")
        .join(" · "),
      epoch_s === null ? fillText(TEXTS.footSinceStart, times) : fillText(TEXTS.foot, times),
    ],
  };
}

/** λ of the visible samples: two numbers if it changed. */
function lambdas(source: PlotSource, seen: TimeRange): string[] {
  const { t, raw, columns } = source.table(Object.keys(TUNING), seen);
  return Object.entries(TUNING).map(([name, symbol]) => {
    const column = columns.find((one) => one.name === name);
    if (column === undefined) return fillText(TEXTS.notRecorded, { symbol });
    const { minimum, maximum } = statistics(column, t, raw);
    if (Number.isNaN(minimum)) return fillText(TEXTS.notInForce, { symbol });
    const value =
      minimum === maximum
        ? short(minimum)
        : fillText(TEXTS.range, { from: short(minimum), to: short(maximum) });
    return fillText(TEXTS.lambda, { symbol, value });
  });
}
