import { expect, it } from "vitest";
import type { LineageNode } from "../../wire/types";
import { addressOfNode, BOX, laidOut } from "./LineageCard";

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

it("puts each box right of all it came from, and no two on the same place", () => {
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

it("ends where boxes would come from each other", () => {
  expect(laidOut([node("a", ["b"]), node("b", ["a"])]).boxes.length).toBe(2);
  expect(laidOut([])).toEqual({ boxes: [], edges: [], width: 0, height: 0 });
});

it("leads to the page that tells more", () => {
  expect(addressOfNode(node("a", [], { bank: 3 }))).toBe("/banks/3");
  expect(addressOfNode(node("a", [], { identification: 4 }))).toBe("/identify/4");
  expect(addressOfNode(node("a", [], { run: 5 }))).toBe("/runs/5");
  expect(addressOfNode(node("a", []))).toBeNull();
});
