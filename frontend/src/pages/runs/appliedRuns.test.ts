import { expect, it } from "vitest";
import { appliedRuns, digestOfParameters } from "./appliedRuns";

const of = (digest: string, run: number | null, undone = false) => ({ digest, run, undone });
const FILE = of("file", null);

it.each([
  ["of the file", [FILE], "file", []],
  ["of another installation", [of("a", 2), FILE], "other", []],
  ["as applied last", [of("b", 3), of("a", 2), FILE], "b", [2, 3]],
  ["before the last application", [of("b", 3), of("a", 2), FILE], "a", [2]],
  ["after one that was undone", [of("c", 5), of("a", null, true), of("b", 3), of("a", 2), FILE], "c", [2, 5]],
  ["as they were put back", [of("file", null, true), of("a", 2), FILE], "file", []],
])("finds the runs applied to parameters %s", (_, versions, digest, runs) => {
  expect(appliedRuns(versions, digest)).toEqual(runs);
});

it("takes the parameters of the run itself, not of an identification before it", () => {
  const box = (id: string, kind: "run" | "parameters", sha256: string, origins: string[] = []) => ({
    id,
    kind,
    sha256,
    origins,
  });
  const nodes = [
    box("run-7", "run", "r", ["gains", "parameters-new"]),
    box("parameters-old", "parameters", "old"),
    box("parameters-new", "parameters", "new"),
  ];
  expect([digestOfParameters(nodes), digestOfParameters([])]).toEqual(["new", null]);
});
