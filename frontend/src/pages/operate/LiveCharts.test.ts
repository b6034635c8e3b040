import { expect, it } from "vitest";
import type { Limits } from "../../wire/types";
import { limitLines } from "./LiveCharts";

it("labels each line with the value at which it is drawn", () => {
  const limits = {
    q_min: -1.4,
    q_max: 1.4,
    S_min: 8,
    S_max: 15,
    F_min: 0.5,
    F_max: 47.5,
    u_max: 7.25,
  } as Limits;
  const named = limitLines(limits, "deg").filter(({ label }) => /\d/.test(label));
  expect(named).toHaveLength(4);
  for (const { label, value } of named)
    expect(Number(/[−+]?[\d.]+/.exec(label)?.[0].replace("−", "-"))).toBe(value);
});
