/** Where the cells of a map stand, and in which colour. */

import { digitsOver, short } from "../../samples/format";

export type Cells = readonly (readonly (number | null)[])[];

export interface Cell {
  readonly key: string;
  readonly row: number;
  readonly column: number;
  readonly value: number | null;
  readonly left: number;
  readonly top: number;
  readonly width: number;
  readonly height: number;
  /** null where there is no number. */
  readonly colour: string | null;
  /** Of the number in the cell. */
  readonly ink: string;
  readonly text: string;
}

/** From dark to light by even steps of lightness, told apart by all eyes, on light and dark ground (viridis). */
const STOPS = [
  [68, 1, 84],
  [59, 82, 139],
  [33, 145, 140],
  [94, 201, 98],
  [253, 231, 37],
] as const;

/** A cell narrower or lower than this [px] has no number in it. */
const ROOM_X = 34;
const ROOM_Y = 14;
const MOST_TICKS = 8;

/** The colours range over this share of the largest magnitude at least: what is alike looks alike. */
const LEAST_RANGE = 0.05;

/** The colour of a share from 0 to 1. */
export function colourOf(share: number): string {
  return `rgb(${partsOf(share).join(" ")})`;
}

/** Black or white for a text on the colour of a share, whichever is read better (contrast of WCAG 2.1). */
export function inkOf(share: number): string {
  const [red = 0, green = 0, blue = 0] = partsOf(share).map((part) => {
    const value = part / 255;
    return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  });
  const luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue;
  return (luminance + 0.05) ** 2 > 1.05 * 0.05 ? "#000000" : "#ffffff";
}

/** The numbers at the ends of the colours: the least and the largest, and further apart where these are alike. */
export function colourRange(values: readonly number[]): [number, number] {
  const [low, high] = values.length === 0 ? [0, 1] : [Math.min(...values), Math.max(...values)];
  const wide = LEAST_RANGE * Math.max(Math.abs(low), Math.abs(high));
  if (high - low >= wide && high > low) return [low, high];
  const half = wide > 0 ? wide / 2 : 0.5;
  return [(low + high) / 2 - half, (low + high) / 2 + half];
}

/** Red, green and blue from 0 to 255. */
function partsOf(share: number): number[] {
  const at = Math.min(1, Math.max(0, share)) * (STOPS.length - 1);
  const low = Math.min(STOPS.length - 2, Math.floor(at));
  const [from, to] = [STOPS[low] ?? STOPS[0], STOPS[low + 1] ?? STOPS[0]];
  return from.map((part, place) => Math.round(part + (at - low) * ((to[place] ?? part) - part)));
}

/** The cells of a map that is `width` by `height` [px], the first row at the bottom. */
export function cellsOf(cells: Cells, width: number, height: number) {
  const known = cells.flat().filter((value) => value !== null);
  const [low, high] = colourRange(known);
  const digits = digitsOver(known);
  const cellHeight = height / cells.length;
  const drawn = cells.flatMap((row, y) => {
    const cellWidth = width / row.length;
    return row.map((value, x): Cell => {
      const share = value === null ? 0 : (value - low) / (high - low);
      return {
        key: `${y} ${x}`,
        row: y,
        column: x,
        value,
        left: x * cellWidth,
        top: height - (y + 1) * cellHeight,
        width: cellWidth,
        height: cellHeight,
        colour: value === null ? null : colourOf(share),
        ink: value === null ? "var(--text)" : inkOf(share),
        text: value === null || cellWidth < ROOM_X || cellHeight < ROOM_Y ? "" : short(value, digits),
      };
    });
  });
  return { range: known.length === 0 ? null : ([low, high] as const), digits, drawn };
}

/** Which of so many values are written at an axis. */
export function ticksOf(count: number): number[] {
  const step = Math.ceil(count / MOST_TICKS);
  return Array.from({ length: Math.ceil(count / step) }, (_, place) => place * step);
}
