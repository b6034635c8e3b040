import { describe, expect, it } from "vitest";
import { comparedPanels } from "../../charts/sources";
import { curvesOf } from "../../service/api/runs";
import { panelsOf, STANDARD } from "../../theme/layouts";
import { unitOf } from "../../theme/signals";
import type { Differences } from "../../wire/types";
import { bandLines, differencePanel, nameOf } from "./DifferencesCard";

const DRAWN = [7, 9, 4];

describe("the panel of differences", () => {
  it("has each run except the reference, with the mark and line style of its curves", () => {
    const panel = differencePanel("S", DRAWN, 9, "deg");
    expect(panel.traces.map(({ name }) => name)).toEqual(["ΔS", "ΔS′′"]);
    const curves = comparedPanels(panelsOf(STANDARD), 2).flatMap(({ traces }) => traces);
    for (const trace of panel.traces) {
      const curve = curves.find(({ name }) => name === trace.name.slice(1));
      expect([trace.hue, trace.dash]).toEqual([curve?.hue, curve?.dash]);
    }
    expect(unitOf("ΔS′′")).toBe("N·m/rad");
  });

  it("shows angles and the band in the person's unit", () => {
    const panel = differencePanel("q", DRAWN, 7, "deg");
    expect([panel.unit, panel.factor]).toEqual(["°", 180 / Math.PI]);
    const lines = bandLines(panel, Math.PI / 180);
    expect(lines.map(({ value }) => value)).toEqual([1, -1]);
    expect(bandLines(panel, null)).toEqual([]);
    expect(differencePanel("q", DRAWN, 7, "rad").unit).toBe("rad");
    expect(differencePanel("theta_A_ref", DRAWN, 7, "deg").unit).toBe("°");
  });

  it("omits the curves of a run that is not drawn", () => {
    const one = {
      reason: "",
      minimum: [0.5, null],
      maximum: [1, null],
      compared_s: 1,
      missing_s: 1,
      left_at_s: null,
      outside_s: 0,
      longest_s: 0,
      largest: 1,
      largest_at_s: 0,
    };
    const found: Differences = {
      reference: 7,
      signal: "q",
      unit: "rad",
      raw: false,
      width_s: 2,
      t: [0, 2],
      runs: [
        { ...one, run: 4 },
        { ...one, run: 5 },
      ],
    };
    const { signals } = curvesOf(found, (run) => nameOf("q", DRAWN, run));
    expect(Object.keys(signals)).toEqual(["Δq′′"]);
    expect(Array.from(signals["Δq′′"]?.maximum ?? [])).toEqual([1, Number.NaN]);
  });
});
