/** Where each run leaves the band around the reference, for how long, and how far it goes. */

import { Table } from "@mantine/core";
import type { ReactNode } from "react";
import { Absent, Shown } from "../../components/Absent";
import { fixed, significant } from "../../samples/format";
import { labelWith, readingOf } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import type { Differences, RunDifference } from "../../wire/types";
import page from "../Page.module.css";

const NO_BAND = "no tolerance is given";
const NEVER = "it stays within the band";

interface DeviationTableProps {
  readonly found: Differences;
  /** In SI; null where none is given. */
  readonly band: number | null;
}

export function DeviationTable({ found, band }: DeviationTableProps) {
  const angles = useAngles();
  const { factor } = readingOf(found.unit, angles);
  return (
    <div className={page.tableScroll}>
      <Table aria-label="Deviations" verticalSpacing={4}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>Run</Table.Th>
            <Table.Th className={page.number}>Leaves the band at [s]</Table.Th>
            <Table.Th className={page.number}>Outside together [s]</Table.Th>
            <Table.Th className={page.number}>Longest [s]</Table.Th>
            <Table.Th className={page.number}>{labelWith("Largest", found.unit, angles)}</Table.Th>
            <Table.Th className={page.number}>at [s]</Table.Th>
            <Table.Th className={page.number}>Compared [s]</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {found.runs.map((one) => (
            <Table.Tr key={one.run}>
              <Table.Td>Run {one.run}</Table.Td>
              {one.reason === "" ? (
                <Figures one={one} banded={band !== null} factor={factor} />
              ) : (
                <Table.Td colSpan={6}>not measured: {one.reason}</Table.Td>
              )}
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}

interface FiguresProps {
  readonly one: RunDifference;
  readonly banded: boolean;
  readonly factor: number;
}

function Figures({ one, banded, factor }: FiguresProps) {
  const within = (figure: ReactNode) => (banded ? figure : <Absent why={NO_BAND} />);
  const cells = [
    within(
      <Shown value={one.left_at_s} why={NEVER}>
        {(at_s) => fixed(at_s, 3)}
      </Shown>,
    ),
    within(fixed(one.outside_s, 3)),
    within(fixed(one.longest_s, 3)),
    one.largest === null ? "" : significant(one.largest * factor, 4),
    one.largest_at_s === null ? "" : fixed(one.largest_at_s, 3),
    `${fixed(one.compared_s, 3)}${one.missing_s > 0 ? ` of ${fixed(one.compared_s + one.missing_s, 3)}` : ""}`,
  ];
  return cells.map((cell, place) => (
    // biome-ignore lint/suspicious/noArrayIndexKey: columns have a place and nothing else to tell them by
    <Table.Td key={place} className={page.number}>
      {cell}
    </Table.Td>
  ));
}
