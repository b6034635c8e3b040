import { expect, it } from "vitest";
import type { State } from "../../wire/types";
import { whyNoReferences, whyNoStart } from "./ReferencesCard";

const FREE = {
  mode: "run",
  legal_modes: ["experiment"],
  task: null,
  trial: null,
  unready: "",
  touch: { felt: null },
} as unknown as State;
const changed = (part: object) => ({ ...FREE, ...part }) as State;

it("starts nothing beside a run or a tuning on trial, which the service refuses", () => {
  expect(whyNoStart(FREE, "experiment", null)).toBeNull();
  expect(whyNoStart(changed({ task: { run: 3 } }), "experiment", null)).toBe("Another task is running.");
  expect(whyNoStart(changed({ trial: { remaining_s: 4 } }), "experiment", null)).toContain("on trial");
  expect(whyNoStart(changed({ mode: "off", legal_modes: ["pretension"] }), "experiment", null)).toContain(
    "slack",
  );
});

it("takes references in run and compliance only, and none while the joint gives way", () => {
  expect(whyNoReferences(null, null)).toBe("not known yet");
  for (const mode of ["run", "compliance"]) expect(whyNoReferences(changed({ mode }), null)).toBeNull();
  for (const mode of ["off", "pretension", "experiment", "tripped"]) {
    expect(whyNoReferences(changed({ mode }), null)).toBe("set in run and compliance");
  }
  expect(whyNoReferences(changed({ mode: "off", player: { t: 1 } }), null)).toBe("a recording is played");
  expect(whyNoReferences(changed({ touch: { felt: { F: 6 } } }), null)).toContain("gives way");
});
