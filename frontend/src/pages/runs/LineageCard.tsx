import { ActionIcon, Table } from "@mantine/core";
import { useClipboard } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { Fragment, useMemo } from "react";
import { TbCheck, TbCopy } from "react-icons/tb";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { Verdict } from "../../components/RunState";
import { localizeText } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { parametersQuery } from "../../service/api/identifications";
import { useAngleUnit } from "../../service/api/preferences";
import { lineageQuery } from "../../service/api/runs";
import type { Lineage, LineageNode, Parameters } from "../../wire/types";
import pageStyles from "../Page.module.css";
import runsStyles from "./Runs.module.css";
import { TEXTS } from "./texts";

/** Finds the identifications that were applied to the parameters of a run. Pure. */

type Version = Pick<Parameters["versions"][number], "digest" | "run" | "undone">;
type Node = Pick<Lineage["nodes"][number], "id" | "kind" | "sha256" | "origins">;

/** Returns the digest of the parameters of the first box, which is the run; null if unknown. */
export function digestOfParameters(nodes: readonly Node[]): string | null {
  const origins = nodes[0]?.origins ?? [];
  return nodes.find(({ id, kind }) => kind === "parameters" && origins.includes(id))?.sha256 ?? null;
}

/** Returns the runs whose results these parameters contain, oldest first; `versions` is newest first. */
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

/** Layout of the boxes of a lineage, with origins on the left and results on the right. Pure. */

export const BOX = { width: 178, height: 76, across: 44, down: 14 } as const;

interface Placed {
  readonly node: LineageNode;
  readonly x: number;
  readonly y: number;
}

interface Picture {
  readonly boxes: readonly Placed[];
  readonly edges: readonly { readonly key: string; readonly from: Placed; readonly to: Placed }[];
  readonly width: number;
  readonly height: number;
}

/** Places each box in the first column to the right of all its origins, in the next free row. */
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

/** Diagram of the lineage; each box shows its digest, links to its page, and can be out of date. */

const SHORT = 12;
const MARGIN = 2;
/** Characters that fit into a box. */
const FIT = 27;

function LineagePicture({ nodes, self }: { nodes: readonly LineageNode[]; self: string }) {
  const picture = useMemo(() => laidOut(nodes), [nodes]);
  const [width, height] = [picture.width + 2 * MARGIN, picture.height + 2 * MARGIN];
  return (
    <>
      <div className={runsStyles.picture}>
        {/* biome-ignore lint/a11y/useSemanticElements: an SVG cannot be a fieldset */}
        <svg
          width={width}
          height={height}
          viewBox={`${-MARGIN} ${-MARGIN} ${width} ${height}`}
          role="group"
          aria-label={TEXTS.lineageDiagram}
        >
          {picture.edges.map(({ key, from, to }) => (
            <Arrow key={key} from={from} to={to} />
          ))}
          {picture.boxes.map((placed) => (
            <Box key={placed.node.id} placed={placed} self={placed.node.id === self} />
          ))}
        </svg>
      </div>
      <Digests nodes={nodes} />
    </>
  );
}

function Arrow({ from, to }: { from: Placed; to: Placed }) {
  const [x0, y0] = [from.x + BOX.width, from.y + BOX.height / 2];
  const [x1, y1] = [to.x - 6, to.y + BOX.height / 2];
  const bend = Math.max(20, (x1 - x0) / 2);
  return (
    <g>
      <path
        className={runsStyles.edge}
        d={`M${x0},${y0} C${x0 + bend},${y0} ${x1 - bend},${y1} ${x1},${y1}`}
      />
      <path className={runsStyles.arrow} d={`M${x1 + 6},${y1} l-7,-4 v8 z`} />
    </g>
  );
}

function Box({ placed: { node, x, y }, self }: { placed: Placed; self: boolean }) {
  const angles = useAngleUnit();
  const address = self ? null : addressOfNode(node);
  const outdated = localizeText(node.out_of_date, angles);
  const detail = localizeText(node.detail, angles);
  const inside = (
    <>
      <title>{[node.title, detail, outdated].filter((part) => part !== "").join("\n")}</title>
      <rect
        className={runsStyles.node}
        data-self={self}
        data-outdated={outdated !== ""}
        width={BOX.width}
        height={BOX.height}
        rx={6}
      />
      <text className={runsStyles.name} x={10} y={19}>
        {cut(node.title)}
      </text>
      <text className={runsStyles.detail} x={10} y={36}>
        {cut(detail)}
      </text>
      <text className={`${runsStyles.detail} ${runsStyles.hash}`} x={10} y={52}>
        {node.sha256 === null ? TEXTS.noDigest : node.sha256.slice(0, SHORT)}
      </text>
      {outdated !== "" && (
        <text className={runsStyles.outdated} x={10} y={68}>
          ⚠ {TEXTS.outOfDate}
        </text>
      )}
    </>
  );
  return (
    <g transform={`translate(${x},${y})`}>
      {address === null ? (
        inside
      ) : (
        <Link
          href={address}
          className={runsStyles.link}
          aria-label={outdated === "" ? node.title : fillText(TEXTS.outOfDateLink, { title: node.title })}
        >
          {inside}
        </Link>
      )}
    </g>
  );
}

function cut(text: string): string {
  return text.length <= FIT ? text : `${text.slice(0, FIT - 1)}…`;
}

/** Returns the page with the details of a box; null if it has none. */
export function addressOfNode({ bank, identification, run }: LineageNode): string | null {
  if (bank !== null) return `/banks/${bank}`;
  if (identification !== null) return `/identify/${identification}`;
  return run === null ? null : `/runs/${run}`;
}

function Digests({ nodes }: { nodes: readonly LineageNode[] }) {
  const angles = useAngleUnit();
  return (
    <Table aria-label={TEXTS.digests} verticalSpacing={2}>
      <Table.Thead>
        <Table.Tr>
          <Table.Th>{TEXTS.item}</Table.Th>
          <Table.Th>{TEXTS.sha256}</Table.Th>
          <Table.Th>{TEXTS.outOfDate}</Table.Th>
        </Table.Tr>
      </Table.Thead>
      <Table.Tbody>
        {nodes.map((node) => (
          <Table.Tr key={node.id}>
            <Table.Td>{node.title}</Table.Td>
            <Table.Td>
              {node.sha256 === null ? (
                localizeText(node.no_sha256, angles)
              ) : (
                <Digest title={node.title} sha256={node.sha256} />
              )}
            </Table.Td>
            <Table.Td>
              {node.out_of_date === "" ? TEXTS.upToDate : localizeText(node.out_of_date, angles)}
            </Table.Td>
          </Table.Tr>
        ))}
      </Table.Tbody>
    </Table>
  );
}

function Digest({ title, sha256 }: { title: string; sha256: string }) {
  const { copy, copied } = useClipboard({ timeout: 1500 });
  return (
    <span title={sha256}>
      <code className={runsStyles.hash}>{sha256.slice(0, SHORT)}</code>{" "}
      <ActionIcon
        size={18}
        variant="subtle"
        color="gray"
        aria-label={fillText(TEXTS.copyDigest, { title })}
        onClick={() => copy(sha256)}
      >
        {copied ? <TbCheck size={12} /> : <TbCopy size={12} />}
      </ActionIcon>
    </span>
  );
}

/** Card with the lineage of a run: parameters, bank, identifications, and banks built from the run. */

export function LineageCard({ run }: { run: number }) {
  const { data, error } = useQuery(lineageQuery(run));
  return (
    <Card title={TEXTS.lineage}>
      {data === undefined ? (
        <p className={pageStyles.empty}>{error?.message ?? TEXTS.loading}</p>
      ) : (
        <>
          <LineagePicture nodes={data.nodes} self={`run-${run}`} />
          <Origins lineage={data} />
        </>
      )}
    </Card>
  );
}

function Origins({ lineage }: { lineage: Lineage }) {
  const { parameters, parameters_as_now, software, bank, entries, banks_built, runs_with_them } = lineage;
  return (
    <dl className={pageStyles.facts}>
      <dt>{TEXTS.software}</dt>
      <dd>{fillText(TEXTS.sinew, { version: software })}</dd>
      <dt>{TEXTS.parameters}</dt>
      <dd>
        <Verdict good={parameters_as_now}>
          {fillText(parameters_as_now ? TEXTS.unchanged : TEXTS.changedSince, { parameters })}
        </Verdict>
        <AppliedFrom lineage={lineage} />
      </dd>
      <dt>{TEXTS.gains}</dt>
      <dd>
        {bank === null ? (
          TEXTS.geometricGains
        ) : (
          <Link href={`/banks/${bank.id}`}>
            {fillText(TEXTS.bank, { bank: bank.name, version: bank.version })}
          </Link>
        )}
      </dd>
      {entries.map((entry) => (
        <Fragment key={entry.S_nominal}>
          <dt>{fillText(TEXTS.operatingPoint, { point: entry.name })}</dt>
          <dd>
            {entry.run === null ? TEXTS.notFromRun : <RunLink run={entry.run} text={TEXTS.identifiedIn} />}
          </dd>
        </Fragment>
      ))}
      {banks_built.length > 0 && (
        <>
          <dt>{TEXTS.banksBuilt}</dt>
          <dd className={pageStyles.actions}>
            {banks_built.map((one) => (
              <Link key={one.id} href={`/banks/${one.id}`}>
                {fillText(TEXTS.bank, { bank: one.name, version: one.version })}
              </Link>
            ))}
          </dd>
          <dt>{TEXTS.runsWithBanks}</dt>
          <dd className={pageStyles.actions}>
            {runs_with_them.length === 0
              ? TEXTS.none
              : runs_with_them.map((id) => <RunLink key={id} run={id} />)}
          </dd>
        </>
      )}
    </dl>
  );
}

/** Links to the identifications from which the run's parameters have values. */
function AppliedFrom({ lineage }: { lineage: Lineage }) {
  const { data } = useQuery(parametersQuery(null));
  const runs = appliedRuns(data?.versions ?? [], digestOfParameters(lineage.nodes));
  if (runs.length === 0) return null;
  return (
    <span className={pageStyles.dim}>
      {TEXTS.appliedFrom}
      {runs.map((id, index) => (
        <Fragment key={id}>
          {index > 0 && ", "}
          <RunLink run={id} text={TEXTS.runInSentence} />
        </Fragment>
      ))}
    </span>
  );
}

interface RunLinkProps {
  readonly run: number;
  readonly text?: typeof TEXTS.run | typeof TEXTS.runInSentence | typeof TEXTS.identifiedIn;
}

function RunLink({ run, text = TEXTS.run }: RunLinkProps) {
  return <Link href={`/runs/${run}`}>{fillText(text, { run })}</Link>;
}
