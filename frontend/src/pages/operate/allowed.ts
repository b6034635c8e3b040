/** What the service would refuse at present, and why: a control whose command it would not take is not offered. Pure. */

import type { Mode, State } from "../../wire/types";
import { whyNot } from "./ModeCard";

/** Why no experiment and no identification can be started; null where one can. */
export function whyNoStart(state: State | null, mode: Mode): string | null {
  if (state?.task != null) return "Another task is running.";
  if (state?.trial != null) return "A tuning is on trial: keep it or revert it first.";
  return whyNot(state, mode);
}

/** Why the tuning cannot be changed, by whatever part of it; null where it can. */
export function whyNoRetuning(state: State | null): string | null {
  if (state?.own_tuning == null) return null;
  const run = state.task === null ? "A run that is being started" : `Run ${state.task.run}`;
  return `${run} has the tuning, which is part of its record: stop it first, or wait for its end.`;
}

/** Why references cannot be set, as the end of a hint; null where they can. */
export function whyNoReferences(state: State | null): string | null {
  if (state === null) return "not known yet";
  if (state.mode !== "run" && state.mode !== "compliance") return "set in run and compliance";
  return state.touch.felt === null ? null : "the joint gives way to a contact: choose a mode first";
}

/** Why a tuning that rejects pushes cannot come into force; null where it can, or rejects none. */
export function whyNoRejection(state: State | null, k_ext: number | undefined): string | null {
  const known = (state?.touch.learned.length ?? 0) > 0;
  return known || !k_ext
    ? null
    : "It rejects pushes, and nothing is learned of them: learn at rest first (Touch).";
}
