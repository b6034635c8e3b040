import { expect, it } from "vitest";
import type { State } from "../../wire/types";
import { whyNoRejection, whyNoRetuning, whyNoStart } from "./allowed";

const FREE = {
  mode: "run",
  legal_modes: ["experiment"],
  task: null,
  trial: null,
  own_tuning: null,
  unready: "",
  touch: { learned: [] },
} as unknown as State;
const changed = (part: object) => ({ ...FREE, ...part }) as State;

it("starts nothing beside a run or a tuning on trial, which the service refuses", () => {
  expect(whyNoStart(FREE, "experiment")).toBeNull();
  expect(whyNoStart(changed({ task: { run: 3 } }), "experiment")).toBe("Another task is running.");
  expect(whyNoStart(changed({ trial: { remaining_s: 4 } }), "experiment")).toContain("on trial");
  expect(whyNoStart(changed({ mode: "off", legal_modes: ["pretension"] }), "experiment")).toContain("slack");
});

it("changes no tuning that a run has", () => {
  expect(whyNoRetuning(null)).toBeNull();
  expect(whyNoRetuning(FREE)).toBeNull();
  expect(whyNoRetuning(changed({ own_tuning: {}, task: { run: 7 } }))).toMatch(/^Run 7 has the tuning/);
  expect(whyNoRetuning(changed({ own_tuning: {} }))).toMatch(/^A run that is being started has/);
});

it("brings no rejection back of which nothing is learned any more", () => {
  expect(whyNoRejection(FREE, undefined)).toBeNull();
  expect(whyNoRejection(FREE, 0)).toBeNull();
  expect(whyNoRejection(FREE, 0.7)).toContain("learn at rest first");
  expect(whyNoRejection(changed({ touch: { learned: [{ S: 9, F: 0, std_N: 0.01 }] } }), 0.7)).toBeNull();
});
