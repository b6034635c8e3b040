import { expect, it } from "vitest";
import { marginsText } from "./TuningParts";

it("states gain and phase margin, and the lowest stable gain", () => {
  const margins = { M_s: 1.41265, gain_margin: 24.83, gain_reduction_margin: null, phase_margin_deg: 46.62 };
  expect(marginsText(margins)).toBe("M_s 1.413, gain margin 24.8 (27.9 dB), phase margin 47°");
  expect(marginsText({ ...margins, gain_reduction_margin: 0.0401 })).toBe(
    "M_s 1.413, gain margin 0.040 to 24.8 (27.9 dB), phase margin 47°",
  );
  expect(marginsText({ ...margins, gain_margin: null, phase_margin_deg: null })).toBe(
    "M_s 1.413, gain margin unlimited, phase margin unlimited",
  );
});
