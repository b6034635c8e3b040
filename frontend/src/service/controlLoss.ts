/** Whether this page has lost control that it had. Pure. */

import type { State } from "../wire/types";

type Holder = State["holder"];

/** What this page knows of its control; `lost` stays until control is had again or a person has read it. */
export interface ControlKept {
  /** Control that the service has told this page to have. */
  readonly had: number | null;
  readonly lost: { readonly to: string | null; readonly at_ms: number } | null;
}

export const NO_CONTROL: ControlKept = { had: null, lost: null };

/** The service has told who holds control; `mine` is what this page holds, `givenUp` what it gave up itself. */
export function afterTold(
  before: ControlKept,
  holder: Holder,
  mine: number | null,
  givenUp: number | null,
  now_ms: number,
): ControlKept {
  if (holder !== null && holder.epoch === mine)
    return before.had === mine && before.lost === null ? before : { had: mine, lost: null };
  if (before.had === null) return before;
  // the state of before a reload, or one that was on its way: this page holds a newer control by now
  if (mine !== null && mine > before.had) return before;
  if (before.had === givenUp) return { ...before, had: null };
  return { had: null, lost: { to: holder?.name ?? null, at_ms: now_ms } };
}

export function lossSentence({ to }: { readonly to: string | null }): string {
  const how =
    to === null
      ? "Control of this page has ended: it was not heard for too long, or the service was started again."
      : `${to} has taken over control from this page.`;
  return `${how} What you press here commands nothing until you take control.`;
}
