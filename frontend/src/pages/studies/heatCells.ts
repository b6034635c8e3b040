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

/** The colour of a share from 0 to 1. */
export function colourOf(share: number): string {
  const at = Math.min(1, Math.max(0, share)) * (STOPS.length - 1);
  const low = Math.min(STOPS.length - 2, Math.floor(at));
  const [from, to] = [STOPS[low], STOPS[low + 1]];
  if (from === undefined || to === undefined) return "none";
  return `rgb(${from.map((part, place) => Math.round(part + (at - low) * ((to[place] ?? part) - part))).join(" ")})`;
}

/** The cells of a map that is `width` by `height` [px], the first row at the bottom. */
export function cellsOf(cells: Cells, width: number, height: number) {
  const known = cells.flat().filter((value) => value !== null);
  const least = Math.min(...known);
  const largest = Math.max(...known);
  const digits = digitsOver(known);
  const cellHeight = height / cells.length;
  const drawn = cells.flatMap((row, y) => {
    const cellWidth = width / row.length;
    return row.map((value, x): Cell => {
      const share = value === null ? 0 : largest > least ? (value - least) / (largest - least) : 0.5;
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
        ink: share > 0.6 ? "#1b1f24" : "#ffffff",
        text: value === null || cellWidth < ROOM_X || cellHeight < ROOM_Y ? "" : short(value, digits),
      };
    });
  });
  return { least, largest, digits, drawn };
}

/** Which of so many values are written at an axis. */
export function ticksOf(count: number): number[] {
  const step = Math.ceil(count / MOST_TICKS);
  return Array.from({ length: Math.ceil(count / step) }, (_, place) => place * step);
}
