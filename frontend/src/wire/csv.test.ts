import { expect, it } from "vitest";
import { fromCsv } from "./csv";

it("gives back the columns of a file, what does not exist as no number", () => {
  const read = fromCsv("# sinew\n# t [s] t: time\nt,q,V_A\n-0.5,1e-3,nan\n0,-2,0.25\n");
  expect(Object.keys(read)).toEqual(["t", "q", "V_A"]);
  expect(Array.from(read.t ?? [])).toEqual([-0.5, 0]);
  expect(Array.from(read.q ?? [])).toEqual([0.001, -2]);
  expect(Array.from(read.V_A ?? [])).toEqual([Number.NaN, 0.25]);
});
