/** Which signals matter in which step of the bring-up, and whether one moves. Pure. */

import type { SampleWindow } from "../../samples/window";
import { unitOf } from "../../theme/signals";
import type { SignalName } from "../../wire/sample.gen";
import type { BringUpStep } from "../../wire/types";

type StepId = BringUpStep["id"];

const ANGLES = ["q", "theta_A", "theta_B"] as const;
const FORCES = ["F_A", "F_B"] as const;
const VOLTAGES = ["u_A", "u_B"] as const;

/** What the card converts: beside the newtons that are only being calibrated. */
const VOLTS = ["V_A", "V_B"] as const;

const SIGNALS: Readonly<Record<StepId, readonly SignalName[]>> = {
  wiring_test: [...ANGLES, ...FORCES],
  tare: [...FORCES, ...VOLTS],
  calibrate: [...FORCES, ...VOLTS],
  zero: ANGLES,
  direction: [...ANGLES, ...FORCES, ...VOLTAGES],
  home: [...ANGLES, ...FORCES, ...VOLTAGES],
  pretension: [...FORCES, ...VOLTAGES],
  safety_module: [...FORCES, ...VOLTAGES],
};

/** What to look at during a step. */
export function signalsOf(step: StepId): readonly SignalName[] {
  return SIGNALS[step];
}

export type Movement = "rising" | "falling" | "still" | "unknown";

/** A change within `OVER_S` that a hand makes and noise does not: three counts of the joint's encoder, a tenth of a pull. */
const MOVES: Readonly<Record<string, number>> = { rad: 0.005, N: 0.5, V: 0.02 };
const OVER_S = 0.4;
/** Part at either end of it that is averaged, which takes the noise of a load cell down tenfold. */
const AVERAGED_S = 0.1;

/** Where a signal goes at present; "unknown" while there are too few samples, or one of them is no number. */
export function movement(window: SampleWindow, name: string, period_s: number): Movement {
  const span = Math.round(OVER_S / period_s);
  const part = Math.round(AVERAGED_S / period_s);
  const change =
    mean(window, name, window.endTick - part, part) - mean(window, name, window.endTick - span, part);
  if (Number.isNaN(change)) return "unknown";
  if (Math.abs(change) < (MOVES[unitOf(name)] ?? 0)) return "still";
  return change > 0 ? "rising" : "falling";
}

function mean(window: SampleWindow, name: string, from: number, count: number): number {
  let sum = 0;
  for (let tick = from; tick < from + count; tick++) sum += window.at(name, tick);
  return sum / count;
}
