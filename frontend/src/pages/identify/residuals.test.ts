import { expect, test } from "vitest";
import { residualOutcome } from "./ActuatorResult";

const TEST = {
  lags_s: [0.1, 0.2],
  correlation: [0.01, 0.3],
  bound: [0.28, 0.28],
  statistic: 3.01,
  critical: 2.81,
  level: 0.01,
  passed: false,
};

test("a residual test says which test, its statistic and its level", () => {
  expect(residualOutcome(TEST, "white", "coloured")).toBe(
    "coloured: largest of 2 correlations 3.0 standard deviations, bound 2.8 at the 1 % level for all lags together",
  );
  expect(residualOutcome({ ...TEST, passed: true }, "white", "coloured")).toMatch(/^white: /);
});
