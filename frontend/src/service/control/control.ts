/** Whether this page may send commands, has the control lease, or has lost it. */

import { useQuery } from "@tanstack/react-query";
import { useSyncExternalStore } from "react";
import { useLive } from "../../live/react";
import { fillText } from "../../samples/texts";
import { heldEpoch, watchHeld } from "../../wire/control";
import type { State } from "../../wire/types";
import { sessionQuery } from "../api/session";
import { whyNoRetuning } from "../api/tuning";
import { TEXTS } from "../texts";

type Holder = State["holder"];

/** Control of this page; `lost` persists until the page has control again or a person has dismissed it. */
export interface ControlState {
  /** Epoch of the control lease that the service confirmed for this page. */
  readonly had: number | null;
  readonly lost: { readonly to: string | null; readonly at_ms: number } | null;
}

export const NO_CONTROL: ControlState = { had: null, lost: null };

/** Returns the control after a state; `mine` is the epoch that this page holds, `givenUp` the one it released. */
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
  // a state from before a reload, or a delayed one: this page has a newer lease now
  if (mine !== null && mine > before.had) return before;
  if (before.had === givenUp) return { ...before, had: null };
  return { had: null, lost: { to: holder?.name ?? null, at_ms: now_ms } };
}

export function describeLoss({ to }: { readonly to: string | null }): string {
  return to === null ? TEXTS.lossUnheard : fillText(TEXTS.lossTakenOver, { name: to });
}

/** Whether the signed-in person is an operator; a viewer may only press STOP. Null until the session is loaded. */
export function useMayCommand(): boolean | null {
  const { data } = useQuery(sessionQuery);
  return data === undefined ? null : data.role === "operator";
}

/** Returns why this page cannot send commands; null if it can, or if its first command takes control. */
export function useWhyNoControl(): string | null {
  const epoch = useSyncExternalStore(watchHeld, heldEpoch);
  return useLive((live) => whyNoControl(live.state?.holder ?? null, epoch));
}

/** Returns why this page cannot change the tuning; null if it can. */
export function useWhyNoRetuning(): string | null {
  const noControl = useWhyNoControl();
  return useLive((live) => whyNoRetuning(live.state, noControl));
}

/** `epoch` is that of this page's control lease; null for none. Pure. */
export function whyNoControl(holder: State["holder"], epoch: number | null): string | null {
  if (holder === null || holder.lost) return null;
  // a lease as new as the holder's or newer: this page has control, and the state may be older
  if (epoch !== null && epoch >= holder.epoch) return null;
  return fillText(holder.page ? TEXTS.hasControl : TEXTS.scriptHasControl, { name: holder.name });
}
