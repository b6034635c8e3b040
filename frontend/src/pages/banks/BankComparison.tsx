import { NativeSelect, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Card } from "../../components/Card";
import { SignalName } from "../../components/values";
import { useLive } from "../../live/react";
import { fixed, significant } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { bankDifferenceQuery } from "../../service/api/banks";
import { tuningKey } from "../../service/api/tuning";
import type { Bank, BankDifference, LoopFigures } from "../../wire/types";
import pageStyles from "../Page.module.css";
import { changeOf, entryName, LOOPS, type Loop, nameOf } from "./BankTable";
import { TEXTS } from "./texts";

/** Models, gains and robustness before and after a change of operating points; unchanged values are grey. */

const FIGURES = [
  { name: "K", unit: "" },
  { name: "T", unit: " [s]" },
  { name: "k_p", unit: "" },
  { name: "k_i", unit: " [1/s]" },
] as const;

export function DifferenceTable({ difference }: { difference: BankDifference }) {
  return (
    <>
      <div className={pageStyles.tableScroll} style={{ margin: 0 }}>
        <Table aria-label={TEXTS.difference} verticalSpacing={3}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{TEXTS.point}</Table.Th>
              <Table.Th>{TEXTS.loop}</Table.Th>
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
      <span className={pageStyles.dim}>
        {fillText(TEXTS.gainsAt, { lam_q: fixed(difference.lam_q, 3), lam_S: fixed(difference.lam_S, 3) })}
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
    figures === undefined ? undefined : figures.M_s === null ? TEXTS.unstable : fixed(figures.M_s, 3);
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
    <Table.Td className={change.changed ? undefined : pageStyles.dim} style={{ whiteSpace: "nowrap" }}>
      {change.text}
    </Table.Td>
  );
}

/** Shows the effects of using this bank instead of another one. */

export function BankComparison({ bank, all }: { bank: Bank; all: readonly Bank[] }) {
  const others = all.filter((other) => other.id !== bank.id);
  const likely = others.find((other) => other.active) ?? others.find((other) => other.name === bank.name);
  const [chosen, setChosen] = useState((likely ?? others[0])?.id ?? 0);
  const lambdas = useLive((live) => tuningKey(live.state?.tuning));
  const difference = useQuery(bankDifferenceQuery(chosen, bank.id, lambdas));
  return (
    <Card title={fillText(TEXTS.changes, { bank: nameOf(bank) })}>
      <div className={pageStyles.fields}>
        <NativeSelect
          label={TEXTS.comparedWith}
          w={260}
          value={String(chosen)}
          data={others.map((other) => ({
            value: String(other.id),
            label: other.active ? fillText(TEXTS.activeOption, { bank: nameOf(other) }) : nameOf(other),
          }))}
          onChange={(event) => setChosen(Number(event.currentTarget.value))}
        />
        {difference.isPending && <p className={pageStyles.empty}>{TEXTS.comparing}</p>}
        {difference.error && <p className={pageStyles.empty}>{difference.error.message}</p>}
        {difference.data && <DifferenceTable difference={difference.data} />}
      </div>
    </Card>
  );
}
