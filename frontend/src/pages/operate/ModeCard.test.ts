import { expect, it } from "vitest";
import type { State } from "../../wire/types";
import { whyNot } from "./ModeCard";

const state = (mode: string, legal_modes: string[]) =>
  ({ mode, legal_modes, pretension_done: true, unready: "" }) as unknown as State;

it("names modes as their buttons do", () => {
  expect(whyNot(state("run", ["pretension", "compliance"]), "run")).toBe("The mode is Run already.");
  expect(whyNot(state("compliance", ["pretension", "run", "stopping"]), "identify")).toBe(
    "Not possible from Compliance. Possible now: Pretension, Run, Soft stop.",
  );
});

it("says that a paused order has to go on or be stopped first", () => {
  const pretension = state("pretension", ["stopping", "off"]);
  const paused = { ...pretension, task: { phase: "paused" } } as State;
  expect(whyNot(paused, "run")).toBe("An order is paused in pretension: go on, or stop softly.");
  expect(whyNot(paused, "stopping")).toBeNull();
  expect(whyNot(pretension, "run")).toBe("Not possible from Pretension. Possible now: Soft stop, Off.");
});

it("says what has to come before pretension", () => {
  const off = { ...state("off", []), unready: "set the zero in the bring-up" };
  expect(whyNot(off, "pretension")).toBe("Set the zero in the bring-up.");
  expect(whyNot(off, "run")).toBe("Set the zero in the bring-up.");
  expect(whyNot(off, "stopping")).toBe("Not possible from Off. Possible now: nothing but STOP.");
});
