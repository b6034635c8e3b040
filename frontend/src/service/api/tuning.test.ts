import { expect, it } from "vitest";
import { fillText } from "../../samples/texts";
import type { State } from "../../wire/types";
import { TEXTS } from "../texts";
import { whyNoRejection, whyNoRetuning, whyNoStep } from "./tuning";

const FREE = {
  mode: "run",
  legal_modes: ["experiment"],
  task: null,
  trial: null,
  own_tuning: null,
  earlier: null,
  unready: "",
  touch: { learned: [] },
} as unknown as State;
const changed = (part: object) => ({ ...FREE, ...part }) as State;

it("gives the reason why the tuning of a run cannot change", () => {
  expect(whyNoRetuning(null, null)).toBeNull();
  expect(whyNoRetuning(FREE, null)).toBeNull();
  expect(whyNoRetuning(changed({ own_tuning: {}, task: { run: 7 } }), null)).toBe(
    fillText(TEXTS.tuningLocked, { run: 7 }),
  );
  expect(whyNoRetuning(changed({ own_tuning: {} }), null)).toBe(TEXTS.tuningLockedAtStart);
});

it("refuses disturbance rejection without a calibrated bias", () => {
  expect(whyNoRejection(FREE, undefined)).toBeNull();
  expect(whyNoRejection(FREE, 0)).toBeNull();
  expect(whyNoRejection(FREE, 0.7)).toContain(TEXTS.notCalibrated);
  expect(whyNoRejection(changed({ touch: { learned: [{ S: 9, F: 0, std_N: 0.01 }] } }), 0.7)).toBeNull();
});

const learned = (...deviations: number[]) =>
  changed({
    touch: { learned: deviations.map((std_N, n) => ({ S: 8 + n, F: 0, std_N })) },
    earlier: { k_ext: 0.7 },
  });

it("refuses disturbance rejection if a deviation of the estimate exceeds 0.05 N, a sixth of 0.3 N", () => {
  expect(whyNoRejection(learned(0.01, 0.0499), 0.7)).toBeNull();
  expect(whyNoRejection(learned(0.0501, 0.01), 0.7)).toContain("is 0.0501 N, above 0.05 N");
  expect(whyNoRejection(learned(0.01, 0.08), 0.7)).toContain("is 0.08 N, above 0.05 N. Calibrate again");
  expect(whyNoRejection(learned(0.050000123), 0.7)).toContain("is 0.0500001 N, above 0.05 N");
  expect(whyNoRejection(learned(0.08), 0)).toBeNull();
});

it("gives the reasons for which the service refuses undo and redo", () => {
  expect(whyNoStep("undo", FREE, null)).toBe(TEXTS.nothingToUndo);
  expect(whyNoStep("undo", learned(0.01), null)).toBeNull();
  expect(whyNoStep("undo", changed({ earlier: { k_ext: 0 } }), null)).toBeNull();
  expect(whyNoStep("undo", changed({ earlier: { k_ext: 0 }, trial: { remaining_s: 4 } }), null)).toBe(
    TEXTS.onTrial,
  );
  expect(
    whyNoStep("undo", changed({ earlier: { k_ext: 0 }, own_tuning: {}, task: { run: 7 } }), null),
  ).toContain("run 7");
  expect(whyNoStep("undo", changed({ earlier: { k_ext: 0.7 } }), null)).toContain(TEXTS.notCalibrated);
  expect(whyNoStep("undo", learned(0.08), null)).toContain("0.08 N");
  expect(whyNoStep("redo", changed({ earlier: { k_ext: 0 } }), null)).toBe(TEXTS.nothingToRedo);
  expect(whyNoStep("redo", changed({ later: { k_ext: 0 } }), null)).toBeNull();
});
