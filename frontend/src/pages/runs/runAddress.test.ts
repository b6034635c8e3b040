import { describe, expect, it } from "vitest";
import { addressOf, askedOf, type Compared, comparedIn, RUNS, textOf, USUAL } from "./runAddress";

const CHOSEN: Compared = {
  reference: 3,
  by: "step",
  step: "S_ref",
  event: "mode",
  number: 4,
  signal: "F_ext_hat",
  band: 0.0125,
};

describe("settings of a comparison", () => {
  it("survive conversion to an address and back", () => {
    const address = addressOf(1, [2, 3], null, textOf(CHOSEN));
    const how = RUNS.exec(address)?.groups?.how;
    expect(comparedIn(how)).toEqual({ compared: CHOSEN, problem: "" });
    expect(RUNS.exec(address)?.groups?.others).toBe("2,3");
    expect(textOf(USUAL)).toBe("");
    expect(comparedIn(undefined)).toEqual({ compared: USUAL, problem: "" });
  });

  it("use the default for invalid parts of an address, and report these", () => {
    const { compared, problem } = comparedIn("by=magic;number=0;band=-1;band=x;reference=2.5;signal=S;odd");
    expect(compared).toEqual({ ...USUAL, signal: "S" });
    for (const part of ["by=magic", "number=0", "band=-1", "band=x", "reference=2.5", "odd"]) {
      expect(problem).toContain(part);
    }
  });

  it("use the first run as the reference if the selected one is not among the runs", () => {
    expect(askedOf([1, 2, 3], CHOSEN).reference).toBe(3);
    expect(askedOf([1, 2], CHOSEN).reference).toBe(1);
    expect(askedOf([5, 2], USUAL)).toMatchObject({ run: [5, 2], reference: 5, by: "begin", number: 1 });
  });
});
