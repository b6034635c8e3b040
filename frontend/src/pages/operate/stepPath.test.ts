import { describe, expect, it } from "vitest";
import { stepPath } from "./stepPath";

describe("stepPath", () => {
  const lam = 0.5;
  const t = Array.from({ length: 200 }, (_, k) => (8 * lam * k) / 199);
  const y = t.map((time) => 1 - (1 + time / lam) * Math.exp(-time / lam));

  it("reads the time to 90 % between the points, to the digits that are shown", () => {
    // 1 − (1 + x) exp(−x) = 0.9 at x = 3.8897
    expect(stepPath(t, y, 150, 46).t_90).toBeCloseTo(lam * 3.8897, 3);
  });

  it("knows none where 90 % are not reached", () => {
    expect(stepPath(t.slice(0, 90), y.slice(0, 90), 150, 46).t_90).toBeNull();
    expect(stepPath([], [], 150, 46).t_90).toBeNull();
  });
});
