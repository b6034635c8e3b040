import { expect, it } from "vitest";
import type { State } from "../../wire/types";
import { whyNoStart } from "./allowed";

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
