/** How an entry is called, its fit is told, and a change of a figure is written. Pure. */

import { fixed, NOT_MEASURED, short, significant } from "../../samples/format";

export const LOOPS = ["position", "stiffness"] as const;
export type Loop = (typeof LOOPS)[number];

/** An entry goes by its tension; where that is not known, by its stiffness. */
export function entryName(entry: { S_nominal: number; tension_N: number | null }): string {
  return entry.tension_N === null ? `${fixed(entry.S_nominal, 2)} N·m/rad` : `${short(entry.tension_N)} N`;
}

/** How good a model is: "98.2 %", or that it was not measured. */
export function percent(value: number | null): string {
  return value === null ? NOT_MEASURED : `${significant(value, 3)} %`;
}

export interface Change {
  readonly text: string;
  readonly changed: boolean;
}

/** Figures as they are shown: a difference that no one could read is none. */
export function changeOf(before: string | undefined, after: string | undefined): Change {
  if (before === undefined)
    return { text: after === undefined ? "in neither" : `new: ${after}`, changed: true };
  if (after === undefined) return { text: `gone: ${before}`, changed: true };
  return before === after ? { text: after, changed: false } : { text: `${before} → ${after}`, changed: true };
}
