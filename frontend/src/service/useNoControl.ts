/** Whether somebody else holds control, so that the service would refuse each command of this page. */

import { useSyncExternalStore } from "react";
import { useLive } from "../live/react";
import { heldEpoch, watchHeld } from "../wire/control";
import type { State } from "../wire/types";
import { whyNoRetuning } from "./retuning";

/** Why this page cannot command; null where it can, or would take control with its first command. */
export function useNoControl(): string | null {
  const epoch = useSyncExternalStore(watchHeld, heldEpoch);
  return useLive((live) => whyNoControl(live.state?.holder ?? null, epoch));
}

/** Why the tuning cannot be changed from this page; null where it can. */
export function useNoRetuning(): string | null {
  const noControl = useNoControl();
  return useLive((live) => whyNoRetuning(live.state, noControl));
}

/** `epoch` is the control that this page holds; null for none. Pure. */
export function whyNoControl(holder: State["holder"], epoch: number | null): string | null {
  if (holder === null || holder.lost) return null;
  // a newer control than the state's holder has: the state that names this page is on its way
  if (epoch !== null && epoch >= holder.epoch) return null;
  return `${holder.name} holds control${holder.page ? "" : " by a script"}.`;
}
