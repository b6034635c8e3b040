import { expect, it } from "vitest";
import type { Trigger } from "../wire/types";
import { triggerWords } from "./signals";

const ARMED: Trigger = {
  signal: "F_A",
  condition: "rising",
  level: 20,
  upper: null,
  before_s: 1,
  after_s: 2,
  captures: 3,
  unit: "N",
  says: "F_A rising through 20 N",
  who: "Ana",
  at: "2026-01-01T00:00:00Z",
  phase: "armed",
  captured: 1,
  left_s: 0,
  ended: "",
};

it("says what is waited for, how far a recording is, and why nothing is waited for", () => {
  expect(triggerWords(null)).toBe("Not armed");
  expect(triggerWords(ARMED)).toBe("Armed: F_A rising through 20 N; 1 of 3 captured");
  expect(triggerWords({ ...ARMED, phase: "capturing", left_s: 1.25 })).toMatch(
    /^Recording: .*; 1\.[23] s left$/,
  );
  expect(triggerWords({ ...ARMED, phase: "ended", captured: 3, ended: "all captures were made" })).toBe(
    "Not armed: all captures were made; 3 of 3 captured",
  );
});
