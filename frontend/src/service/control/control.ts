/** Whether this page may command, holds control, or has lost it. */

import { useQuery } from "@tanstack/react-query";
import { useSyncExternalStore } from "react";
import { useLive } from "../../live/react";
import { fillText } from "../../samples/texts";
import { heldEpoch, watchHeld } from "../../wire/control";
import type { State } from "../../wire/types";
import { sessionQuery } from "../api/session";
import { whyNoRetuning } from "../api/tuning";
import { TEXTS } from "../texts";

/** Whether this page has lost control that it had. Pure. */

type Holder = State["holder"];

/** What this page knows of its control; `lost` stays until control is had again or a person has read it. */
export interface ControlState {
  /** Control that the service has told this page to have. */
  readonly had: number | null;
  readonly lost: { readonly to: string | null; readonly at_ms: number } | null;
}

export const NO_CONTROL: ControlState = { had: null, lost: null };

/** The service has told who holds control; `mine` is what this page holds, `givenUp` what it gave up itself. */
export function nextControlState(
  before: ControlState,
  holder: Holder,
  mine: number | null,
  givenUp: number | null,
  now_ms: number,
): ControlState {
  if (holder !== null && holder.epoch === mine)
    return before.had === mine && before.lost === null ? before : { had: mine, lost: null };
  if (before.had === null) return before;
  // the state of before a reload, or one that was on its way: this page holds a newer control by now
  if (mine !== null && mine > before.had) return before;
  if (before.had === givenUp) return { ...before, had: null };
  return { had: null, lost: { to: holder?.name ?? null, at_ms: now_ms } };
}

export function describeLoss({ to }: { readonly to: string | null }): string {
  return to === null ? TEXTS.lossUnheard : fillText(TEXTS.lossTakenOver, { name: to });
}

/** Whether the signed-in person may change anything: a viewer looks on, and may press STOP. */

/** Null while it is not known yet. */
export function useMayCommand(): boolean | null {
  const { data } = useQuery(sessionQuery);
  return data === undefined ? null : data.role === "operator";
}

/** Whether somebody else holds control, so that the service would refuse each command of this page. */

/** Why this page cannot command; null where it can, or would take control with its first command. */
export function useWhyNoControl(): string | null {
  const epoch = useSyncExternalStore(watchHeld, heldEpoch);
  return useLive((live) => whyNoControl(live.state?.holder ?? null, epoch));
}

/** Why the tuning cannot be changed from this page; null where it can. */
export function useWhyNoRetuning(): string | null {
  const noControl = useWhyNoControl();
  return useLive((live) => whyNoRetuning(live.state, noControl));
}

/** `epoch` is the control that this page holds; null for none. Pure. */
export function whyNoControl(holder: State["holder"], epoch: number | null): string | null {
  if (holder === null || holder.lost) return null;
  // a newer control than the state's holder has: the state that names this page is on its way
  if (epoch !== null && epoch >= holder.epoch) return null;
  return fillText(holder.page ? TEXTS.hasControl : TEXTS.scriptHasControl, { name: holder.name });
}
