import { describe, expect, it } from "vitest";
import { toCsv } from "./timeSeries";

const t = Float64Array.from([0.1, 0.101]);
const unitOf = () => "rad";

describe("toCsv", () => {
  it("writes raw samples with units, and an empty cell for a missing one", () => {
    const values = Float64Array.from([0.25, Number.NaN]);
    const table = {
      raw: true,
      width_s: 0.001,
      t,
      columns: [{ name: "q", minimum: values, maximum: values }],
    };
    expect(toCsv(table, unitOf)).toBe("t [s],q [rad]\n0.1,0.25\n0.101,\n");
  });

  it("writes both extremes of an envelope", () => {
    const column = { name: "q", minimum: Float64Array.from([-1, -2]), maximum: Float64Array.from([1, 2]) };
    const table = { raw: false, width_s: 0.001, t, columns: [column] };
    expect(toCsv(table, unitOf)).toBe("t [s],q_min [rad],q_max [rad]\n0.1,-1,1\n0.101,-2,2\n");
  });
});
