import { describe, expect, it } from "vitest";
import type { LineageNode } from "../../wire/types";
import { addressOfNode, appliedRuns, BOX, digestOfParameters, laidOut } from "./LineageCard";

describe("applied runs", () => {
  const of = (digest: string, run: number | null, undone = false) => ({ digest, run, undone });
  const FILE = of("file", null);

  it.each([
    ["of the file", [FILE], "file", []],
    ["of another installation", [of("a", 2), FILE], "other", []],
    ["as applied last", [of("b", 3), of("a", 2), FILE], "b", [2, 3]],
    ["before the last application", [of("b", 3), of("a", 2), FILE], "a", [2]],
    [
      "after an application that was undone",
      [of("c", 5), of("a", null, true), of("b", 3), of("a", 2), FILE],
      "c",
      [2, 5],
    ],
    ["restored by an undo", [of("file", null, true), of("a", 2), FILE], "file", []],
  ])("finds the runs applied to parameters %s", (_, versions, digest, runs) => {
    expect(appliedRuns(versions, digest)).toEqual(runs);
  });

  it("uses the parameters of the run, not those of an earlier identification", () => {
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
});

describe("lineage layout", () => {
  function node(id: string, origins: string[], pages: Partial<LineageNode> = {}): LineageNode {
    return {
      id,
      kind: "run",
      title: id,
      detail: "",
      sha256: null,
      no_sha256: "",
      out_of_date: "",
      run: null,
      bank: null,
      identification: null,
      origins,
      ...pages,
    };
  }

  it("places each box to the right of its origins, and no two boxes at the same position", () => {
    const nodes = [
      node("run", ["gains", "parameters"]),
      node("gains", ["bank"]),
      node("bank", ["low", "high"]),
      node("low", ["data"]),
      node("high", ["data", "gone"]),
      node("data", ["parameters"]),
      node("parameters", []),
    ];
    const { boxes, edges, width, height } = laidOut(nodes);
    const at = new Map(boxes.map((box) => [box.node.id, box]));
    for (const { from, to } of edges) expect(from.x + BOX.width).toBeLessThan(to.x);
    expect(edges.map(({ key }) => key).sort()).toEqual(
      nodes
        .flatMap(({ id, origins }) => origins.filter((one) => one !== "gone").map((one) => `${one} ${id}`))
        .sort(),
    );
    expect(new Set(boxes.map(({ x, y }) => `${x} ${y}`)).size).toBe(nodes.length);
    expect(at.get("parameters")?.x).toBe(0);
    for (const { x, y } of boxes) {
      expect(x + BOX.width).toBeLessThanOrEqual(width);
      expect(y + BOX.height).toBeLessThanOrEqual(height);
    }
  });

  it("terminates on circular origins", () => {
    expect(laidOut([node("a", ["b"]), node("b", ["a"])]).boxes.length).toBe(2);
    expect(laidOut([])).toEqual({ boxes: [], edges: [], width: 0, height: 0 });
  });

  it("returns the page with the details of a box", () => {
    expect(addressOfNode(node("a", [], { bank: 3 }))).toBe("/banks/3");
    expect(addressOfNode(node("a", [], { identification: 4 }))).toBe("/identify/4");
    expect(addressOfNode(node("a", [], { run: 5 }))).toBe("/runs/5");
    expect(addressOfNode(node("a", []))).toBeNull();
  });
});
