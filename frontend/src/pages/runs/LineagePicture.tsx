/** The lineage of a run as boxes and arrows: each leads to its thing, says its digest, and whether it still holds. */

import { ActionIcon, Table } from "@mantine/core";
import { useClipboard } from "@mantine/hooks";
import { useMemo } from "react";
import { TbCheck, TbCopy } from "react-icons/tb";
import { Link } from "wouter";
import { inWords } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import type { LineageNode } from "../../wire/types";
import { BOX, laidOut, type Placed } from "./lineageLayout";
import styles from "./Runs.module.css";

const SHORT = 12;
const MARGIN = 2;
/** Letters that fit into a box. */
const FIT = 27;

export function LineagePicture({ nodes, self }: { nodes: readonly LineageNode[]; self: string }) {
  const picture = useMemo(() => laidOut(nodes), [nodes]);
  const [width, height] = [picture.width + 2 * MARGIN, picture.height + 2 * MARGIN];
  return (
    <>
      <div className={styles.picture}>
        {/* biome-ignore lint/a11y/useSemanticElements: a fieldset is no part of a drawing */}
        <svg
          width={width}
          height={height}
          viewBox={`${-MARGIN} ${-MARGIN} ${width} ${height}`}
          role="group"
          aria-label="Lineage as a picture"
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
      <path className={styles.edge} d={`M${x0},${y0} C${x0 + bend},${y0} ${x1 - bend},${y1} ${x1},${y1}`} />
      <path className={styles.arrow} d={`M${x1 + 6},${y1} l-7,-4 v8 z`} />
    </g>
  );
}

function Box({ placed: { node, x, y }, self }: { placed: Placed; self: boolean }) {
  const angles = useAngles();
  const address = self ? null : addressOfNode(node);
  const outdated = inWords(node.out_of_date, angles);
  const detail = inWords(node.detail, angles);
  const inside = (
    <>
      <title>{[node.title, detail, outdated].filter((part) => part !== "").join("\n")}</title>
      <rect
        className={styles.node}
        data-self={self}
        data-outdated={outdated !== ""}
        width={BOX.width}
        height={BOX.height}
        rx={6}
      />
      <text className={styles.name} x={10} y={19}>
        {cut(node.title)}
      </text>
      <text className={styles.detail} x={10} y={36}>
        {cut(detail)}
      </text>
      <text className={`${styles.detail} ${styles.hash}`} x={10} y={52}>
        {node.sha256 === null ? "no digest" : node.sha256.slice(0, SHORT)}
      </text>
      {outdated !== "" && (
        <text className={styles.outdated} x={10} y={68}>
          ⚠ out of date
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
          className={styles.link}
          aria-label={`${node.title}${outdated && ", out of date"}`}
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

/** The page that tells more of a box. */
export function addressOfNode({ bank, identification, run }: LineageNode): string | null {
  if (bank !== null) return `/banks/${bank}`;
  if (identification !== null) return `/identify/${identification}`;
  return run === null ? null : `/runs/${run}`;
}

function Digests({ nodes }: { nodes: readonly LineageNode[] }) {
  const angles = useAngles();
  return (
    <Table aria-label="Digests" verticalSpacing={2}>
      <Table.Thead>
        <Table.Tr>
          <Table.Th>What</Table.Th>
          <Table.Th>sha256</Table.Th>
          <Table.Th>Out of date</Table.Th>
        </Table.Tr>
      </Table.Thead>
      <Table.Tbody>
        {nodes.map((node) => (
          <Table.Tr key={node.id}>
            <Table.Td>{node.title}</Table.Td>
            <Table.Td>
              {node.sha256 === null ? (
                inWords(node.no_sha256, angles)
              ) : (
                <Digest title={node.title} sha256={node.sha256} />
              )}
            </Table.Td>
            <Table.Td>{node.out_of_date === "" ? "no" : inWords(node.out_of_date, angles)}</Table.Td>
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
      <code className={styles.hash}>{sha256.slice(0, SHORT)}</code>{" "}
      <ActionIcon
        size={18}
        variant="subtle"
        color="gray"
        aria-label={`Copy the digest of ${title}`}
        onClick={() => copy(sha256)}
      >
        {copied ? <TbCheck size={12} /> : <TbCopy size={12} />}
      </ActionIcon>
    </span>
  );
}
