/** Where the boxes of a lineage stand: origins at the left, what came of them at the right. Pure. */

import type { LineageNode } from "../../wire/types";

export const BOX = { width: 178, height: 76, across: 44, down: 14 } as const;

export interface Placed {
  readonly node: LineageNode;
  readonly x: number;
  readonly y: number;
}

export interface Picture {
  readonly boxes: readonly Placed[];
  readonly edges: readonly { readonly key: string; readonly from: Placed; readonly to: Placed }[];
  readonly width: number;
  readonly height: number;
}

/** Each box stands right of all it came from, as near to what came of it as that leaves room. */
export function laidOut(nodes: readonly LineageNode[]): Picture {
  const byId = new Map(nodes.map((node) => [node.id, node]));
  const columns = columnsOf(nodes, byId);
  const filled = new Map<number, number>();
  const boxes = nodes.map((node): Placed => {
    const column = columns.get(node.id) ?? 0;
    const row = filled.get(column) ?? 0;
    filled.set(column, row + 1);
    return { node, x: column * (BOX.width + BOX.across), y: row * (BOX.height + BOX.down) };
  });
  const placed = new Map(boxes.map((box) => [box.node.id, box]));
  const edges = boxes.flatMap((to) =>
    to.node.origins.flatMap((origin) => {
      const from = placed.get(origin);
      return from === undefined ? [] : [{ key: `${origin} ${to.node.id}`, from, to }];
    }),
  );
  return {
    boxes,
    edges,
    width: Math.max(0, ...boxes.map(({ x }) => x + BOX.width)),
    height: Math.max(0, ...boxes.map(({ y }) => y + BOX.height)),
  };
}

function columnsOf(
  nodes: readonly LineageNode[],
  byId: ReadonlyMap<string, LineageNode>,
): Map<string, number> {
  const depth = new Map<string, number>();
  const visit = (id: string, seen: ReadonlySet<string>): number => {
    const known = depth.get(id);
    if (known !== undefined) return known;
    const origins = (byId.get(id)?.origins ?? []).filter((origin) => byId.has(origin) && !seen.has(origin));
    const found =
      origins.length === 0 ? 0 : 1 + Math.max(...origins.map((one) => visit(one, new Set([...seen, id]))));
    depth.set(id, found);
    return found;
  };
  for (const { id } of nodes) visit(id, new Set());
  return depth;
}
