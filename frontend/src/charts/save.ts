/** Hands a file to the browser's downloads, and makes pictures of drawings. */

import { answered, api, RequestError } from "../wire/client";
import { WIDTH_MM } from "./sheet";
import { withShortPaths } from "./shortPaths";

/** Vectors, the same with its letters for print, or dots at print size. */
export type PictureKind = "svg" | "pdf" | "png";

export function save(content: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  // the download has begun once this task has ended
  setTimeout(() => URL.revokeObjectURL(link.href));
}

/** Let the browser download what the service writes, under the name that it gives; however long, nothing is held here. */
export function saveFrom(address: string): void {
  const link = document.createElement("a");
  link.href = address;
  link.download = "";
  link.click();
}

/** The moment as part of a file name: 2026-03-01-14-05-09, in the person's own zone. */
export function stamp(when: Date): string {
  const parts = [
    when.getMonth() + 1,
    when.getDate(),
    when.getHours(),
    when.getMinutes(),
    when.getSeconds(),
  ].map((part) => String(part).padStart(2, "0"));
  return [when.getFullYear(), ...parts].join("-");
}

/** Dots to the inch in print. */
const DPI = 300;
const REMEDY = "hide some signals, or save it as SVG.";
const TOO_LARGE = `It has too many curves for a PDF: ${REMEDY}`;
/** The service gives a body so long; a link that is too slow for it breaks off without an answer. */
const NOT_SENT = `It could not be sent to the service. If the link is slow, ${REMEDY}`;
const MM_PER_INCH = 25.4;

/** A drawing as a picture of so many millimetres in width. Rejects where the browser cannot draw it. */
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
      canvas.toBlob((content) => (content === null ? reject(new Error("no picture")) : resolve(content)));
    });
  } finally {
    URL.revokeObjectURL(address);
  }
}

/** A drawing as a file. Rejects, with words that can be shown, where it cannot be made. */
export async function picture(svg: string, kind: PictureKind): Promise<Blob> {
  const plain = withPlainColours(svg);
  if (kind === "pdf") return await pdfOf(plain);
  return kind === "svg" ? new Blob([plain], { type: "image/svg+xml" }) : await pngOf(plain, WIDTH_MM);
}

/** A drawing as a PDF of its size, which the service makes. Throws Error, with words that can be shown. */
async function pdfOf(svg: string): Promise<Blob> {
  const body = { svg: withShortPaths(svg) };
  try {
    return await answered(api.POST("/api/chart-sheet.pdf", { body, parseAs: "blob" }));
  } catch (error) {
    const status = error instanceof RequestError ? error.status : null;
    if (status === 413) throw new Error(TOO_LARGE);
    throw status === 0 || status === 408 ? new Error(NOT_SENT) : error;
  }
}

/** A drawing whose colours every program knows: what only browsers reckon with, as they show it. */
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
