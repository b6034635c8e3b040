/** What the service would refuse at present, and why: a control whose command it would not take is not offered. Pure. */

import { ON_TRIAL } from "../../service/retuning";
import type { Mode, State } from "../../wire/types";
import { whyNot } from "./ModeCard";

/** Why no experiment and no identification can be started; null where one can. `noControl` says who holds control. */
export function whyNoStart(state: State | null, mode: Mode, noControl: string | null): string | null {
  if (noControl !== null) return noControl;
  if (state?.task != null) return "Another task is running.";
  if (state?.trial != null) return ON_TRIAL;
  return whyNot(state, mode);
}

/** Why references cannot be set, as the end of a hint; null where they can. */
export function whyNoReferences(state: State | null, noControl: string | null): string | null {
  if (state === null) return "not known yet";
  if (state.player) return "a recording is played";
  if (noControl !== null) return noControl;
  if (state.mode !== "run" && state.mode !== "compliance") return "set in run and compliance";
  return state.touch.felt === null ? null : "the joint gives way to a contact: choose a mode first";
}
