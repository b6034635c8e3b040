import { expect, it } from "vitest";
import type { ExperimentKind } from "../../wire/types";
import { changesInWords, hasChoice, tuningChanges } from "./ExperimentForm";

const SEGMENTS = '[{"duration_s": 4, "q_ref": 0, "S_ref": 10}]';
const KIND = {
  name: "tracking",
  settings: [
    { name: "q_hold", meaning: "joint position held during the stiffness pulses", unit: "rad", default: 0 },
    { name: "hold_s", meaning: "time the load is on, and off", unit: "s", default: 4 },
    { name: "pushes", meaning: "number of pushes; of the hand profile", unit: "1", default: 8 },
    { name: "controller", meaning: "control law; two for comparison", unit: "1", default: "cascade" },
    { name: "quick", meaning: "no pause between", unit: "1", default: false },
    { name: "segments", meaning: "JSON list of segments: duration_s [s]", unit: "1", default: "[]" },
    { name: "lam_q", meaning: "tuning parameter of the position loop", unit: "s", default: 0.5 },
  ],
} as unknown as ExperimentKind;

it("tells what a waiting experiment changes in words and the unit of who reads it, by no name of the code", () => {
  const changed = {
    q_hold: 0.2,
    pushes: 5,
    controller: "single-loop",
    quick: true,
    segments: SEGMENTS,
    lam_q: 2,
  };
  const degrees = changesInWords({ ...changed, hold_s: 4 }, KIND, "deg");
  expect(degrees).toBe(
    "joint position held during the stiffness pulses: 11.4592°; number of pushes: 5; " +
      "control law: single-loop; no pause between: yes; 1 segment, 4 s",
  );
  expect(changesInWords({ q_hold: 0.2 }, KIND, "rad")).toBe(
    "joint position held during the stiffness pulses: 0.2 rad",
  );
  expect(degrees).not.toMatch(/[a-z]+_[a-z]+/i);
  expect(changesInWords({ q_hold: 0, hold_s: 4 }, KIND, "deg")).toBe("its own settings at their defaults");
});

it("adds the segments up", () => {
  const two = JSON.stringify([...JSON.parse(SEGMENTS), ...JSON.parse(SEGMENTS)]);
  expect(changesInWords({ segments: two }, KIND, "deg")).toBe("2 segments, 8 s");
});

it("tells what of a tuning differs from the one in force, and that the plan is off", () => {
  const setting = (name: string, symbol: string, unit: string) => ({ name, symbol, unit, meaning: name });
  const kind = {
    name: "tracking",
    settings: [
      setting("q_hold", "q", "rad"),
      setting("lam_q", "λ_q", "s"),
      setting("motion", "motion", "1"),
      setting("u_plan", "U_plan", "V"),
    ],
  } as unknown as ExperimentKind;
  const inForce = { lam_q: 0.5, motion: "time-optimal", u_plan: 8.5 };
  expect(tuningChanges({ q_hold: 0.2, ...inForce }, inForce, kind, "deg")).toBe("");
  expect(tuningChanges({ lam_q: 0.8, motion: "lambda", u_plan: 6 }, inForce, kind, "deg")).toBe(
    "λ_q 0.8 s (in force 0.5 s), motion lambda (in force time-optimal)",
  );
  expect(tuningChanges({ lam_q: 0.5, motion: "time-optimal", u_plan: 6 }, inForce, kind, "deg")).toBe(
    "U_plan 6 V (in force 8.5 V)",
  );
});

it("offers no field where there is nothing to choose", () => {
  const setting = (minimum: number | null, maximum: number | null) =>
    ({ name: "seed", minimum, maximum }) as unknown as ExperimentKind["settings"][number];
  expect(hasChoice(setting(0, 0))).toBe(false);
  expect(hasChoice(setting(0, 9))).toBe(true);
  expect(hasChoice(setting(null, null))).toBe(true);
});
