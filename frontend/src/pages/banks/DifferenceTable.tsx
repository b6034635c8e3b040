/** Models, gains and robustness before and after a change of entries; what stays the same is grey. */

import { Table } from "@mantine/core";
import { SignalName } from "../../components/SignalName";
import { fixed, significant } from "../../samples/format";
import type { BankDifference, LoopFigures } from "../../wire/types";
import page from "../Page.module.css";
import { changeOf, entryName, LOOPS, type Loop } from "./difference";

const FIGURES = [
  { name: "K", unit: "" },
  { name: "T", unit: " [s]" },
  { name: "k_p", unit: "" },
  { name: "k_i", unit: " [1/s]" },
] as const;

export function DifferenceTable({ difference }: { difference: BankDifference }) {
  return (
    <>
      <div className={page.tableScroll} style={{ margin: 0 }}>
        <Table aria-label="Difference" verticalSpacing={3}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>Entry</Table.Th>
              <Table.Th>Loop</Table.Th>
              {FIGURES.map(({ name, unit }) => (
                <Table.Th key={name}>
                  <SignalName name={name} />
                  {unit}
                </Table.Th>
              ))}
              <Table.Th>
                <SignalName name="M_s" />
              </Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {difference.entries.flatMap((entry) => {
              const present = entry.after ?? entry.before;
              const name = present === null ? "" : entryName(present);
              return LOOPS.map((loop) => (
                <Row
                  key={`${present?.S_nominal} ${loop}`}
                  name={name}
                  loop={loop}
                  before={entry.before?.[loop]}
                  after={entry.after?.[loop]}
                />
              ));
            })}
          </Table.Tbody>
        </Table>
      </div>
      <span className={page.dim}>
        Gains and M_s at the λ in force: λ_q = {fixed(difference.lam_q, 3)} s, λ_S ={" "}
        {fixed(difference.lam_S, 3)} s.
      </span>
    </>
  );
}

interface RowProps {
  readonly name: string;
  readonly loop: Loop;
  readonly before: LoopFigures | undefined;
  readonly after: LoopFigures | undefined;
}

function Row({ name, loop, before, after }: RowProps) {
  const peak = (figures: LoopFigures | undefined) =>
    figures === undefined ? undefined : figures.M_s === null ? "unstable" : fixed(figures.M_s, 3);
  return (
    <Table.Tr>
      {loop === "position" && <Table.Td rowSpan={2}>{name}</Table.Td>}
      <Table.Td>
        <SignalName name={loop === "position" ? "G_q" : "G_S"} />
      </Table.Td>
      {FIGURES.map(({ name: symbol }) => (
        <Cell key={symbol} before={figure(before?.[symbol])} after={figure(after?.[symbol])} />
      ))}
      <Cell before={peak(before)} after={peak(after)} />
    </Table.Tr>
  );
}

function figure(value: number | undefined): string | undefined {
  return value === undefined ? undefined : significant(value, 4);
}

function Cell({ before, after }: { before: string | undefined; after: string | undefined }) {
  const change = changeOf(before, after);
  return (
    <Table.Td className={change.changed ? undefined : page.dim} style={{ whiteSpace: "nowrap" }}>
      {change.text}
    </Table.Td>
  );
}
