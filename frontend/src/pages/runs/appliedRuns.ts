/** From the parameters of a run to the identifications that were applied to them. Pure. */

import type { Lineage, Parameters } from "../../wire/types";

type Version = Pick<Parameters["versions"][number], "digest" | "run" | "undone">;
type Node = Pick<Lineage["nodes"][number], "id" | "kind" | "sha256" | "origins">;

/** Digest of the parameters that the first of the boxes, the run itself, was made with; null where it is not known. */
export function digestOfParameters(nodes: readonly Node[]): string | null {
  const origins = nodes[0]?.origins ?? [];
  return nodes.find(({ id, kind }) => kind === "parameters" && origins.includes(id))?.sha256 ?? null;
}

/** Runs whose identifications were applied up to these parameters, oldest first; `versions` are newest first. */
export function appliedRuns(versions: readonly Version[], digest: string | null): number[] {
  const first = versions.findIndex((version) => version.digest === digest);
  if (digest === null || first < 0) return [];
  const found: number[] = [];
  let undone = 0;
  for (const version of versions.slice(first)) {
    if (version.undone) undone += 1;
    else if (undone > 0) undone -= 1;
    else if (version.run !== null) found.push(version.run);
  }
  return [...new Set(found.reverse())];
}
