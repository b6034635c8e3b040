/** Which changes of the tuning the service would refuse at present, and why. Pure. */

import { digitsApart, short } from "../samples/format";
import { DEVIATIONS, UNSEEN_F } from "../wire/sample.gen";
import type { State } from "../wire/types";

export const ON_TRIAL = "A tuning is on trial: keep it or revert it first.";

/** Why the tuning cannot be changed, by whatever part of it; null where it can. `noControl` says who holds control. */
export function whyNoRetuning(state: State | null, noControl: string | null): string | null {
  if (noControl !== null) return noControl;
  if (state?.own_tuning == null) return null;
  const run = state.task === null ? "A run that is being started" : `Run ${state.task.run}`;
  return `${run} has the tuning, which is part of its record: stop it first, or wait for its end.`;
}

/** Why pushes cannot be rejected; null where they can: what is estimated at rest has to be known, and to be quiet. */
export function whyNoEstimate(state: State | null): string | null {
  const deviations = state?.touch.learned.map(({ std_N }) => std_N) ?? [];
  if (deviations.length === 0) return "Nothing is learned of pushes: learn at rest first (Touch).";
  const noise = Math.max(...deviations);
  const most = UNSEEN_F / DEVIATIONS;
  if (noise <= most) return null;
  const digits = digitsApart([noise, most], 2);
  return `The standard deviation of the estimate is ${short(noise, digits)} N, above ${short(most, digits)} N: learn again with the joint at rest (Touch).`;
}

/** Why a tuning cannot come into force for what it rejects; null where it can, or rejects nothing. */
export function whyNoRejection(state: State | null, k_ext: number | undefined): string | null {
  const reason = k_ext ? whyNoEstimate(state) : null;
  return reason === null ? null : `It rejects pushes. ${reason}`;
}

/** Why the last change cannot be undone; null where it can. */
export function whyNoUndo(state: State | null, noControl: string | null): string | null {
  if (state?.earlier == null) return "Nothing was changed yet";
  if (state.trial !== null) return ON_TRIAL;
  return whyNoRetuning(state, noControl) ?? whyNoRejection(state, state.earlier.k_ext);
}
