/** How a change of a figure is written. Pure. */

export const LOOPS = ["position", "stiffness"] as const;
export type Loop = (typeof LOOPS)[number];

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
