/** Table of all versions of all banks, with the active one. */

import { Button, Table } from "@mantine/core";
import { Link } from "wouter";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { dateTime, fixed, NOT_MEASURED, short, significant } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { useActivateBank } from "../../service/api/banks";
import { useWhyNoRetuning } from "../../service/control/control";
import type { Bank } from "../../wire/types";
import page from "../Page.module.css";
import { TEXTS } from "./texts";

/** Loops with a model in each operating point. */

export const LOOPS = ["position", "stiffness"] as const;
export type Loop = (typeof LOOPS)[number];

/** Returns the name of an operating point: its tension, or its stiffness if the tension is unknown. */
export function entryName(entry: { S_nominal: number; tension_N: number | null }): string {
  return entry.tension_N === null ? `${fixed(entry.S_nominal, 2)} N·m/rad` : `${short(entry.tension_N)} N`;
}

/** Formats a fit: "98.2 %", or that it was not measured. */
export function percent(value: number | null): string {
  return value === null ? NOT_MEASURED : `${significant(value, 3)} %`;
}

interface Change {
  readonly text: string;
  readonly changed: boolean;
}

/** Compares formatted values: a difference below their precision is no change. */
export function changeOf(before: string | undefined, after: string | undefined): Change {
  if (before === undefined)
    return {
      text: after === undefined ? TEXTS.inNeither : fillText(TEXTS.added, { value: after }),
      changed: true,
    };
  if (after === undefined) return { text: fillText(TEXTS.removed, { value: before }), changed: true };
  return before === after ? { text: after, changed: false } : { text: `${before} → ${after}`, changed: true };
}

export function BankTable({ banks, selected }: { banks: readonly Bank[]; selected: number | undefined }) {
  const activate = useActivateBank();
  const locked = useWhyNoRetuning();
  if (banks.length === 0) {
    return <p className={page.empty}>{TEXTS.noBank}</p>;
  }
  return (
    <>
      <div className={page.tableScroll} style={{ marginBottom: 0 }}>
        <Table aria-label={TEXTS.table} highlightOnHover className={page.cards ?? ""}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{TEXTS.bank}</Table.Th>
              <Table.Th>{TEXTS.built}</Table.Th>
              <Table.Th>{TEXTS.by}</Table.Th>
              <Table.Th className={page.number}>{TEXTS.points}</Table.Th>
              <Table.Th>{TEXTS.operatingPoints}</Table.Th>
              <Table.Th>{TEXTS.status}</Table.Th>
              <Table.Th>{TEXTS.file}</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {banks.map((bank) => (
              <Table.Tr key={bank.id} bg={bank.id === selected ? "var(--accent-soft)" : undefined}>
                <Table.Td className={page.cardTitle ?? ""}>
                  <Link href={`/banks/${bank.id}`} style={{ whiteSpace: "nowrap" }}>
                    {nameOf(bank)}
                  </Link>
                </Table.Td>
                <Table.Td style={{ whiteSpace: "nowrap" }}>{dateTime(bank.created)}</Table.Td>
                <Table.Td>{bank.who}</Table.Td>
                <Table.Td className={page.number}>
                  <span className={page.cardLabel}>{TEXTS.points} </span>
                  {bank.entries.length}
                </Table.Td>
                <Table.Td>{bank.entries.map(entryName).join(" · ")}</Table.Td>
                <Table.Td>
                  {bank.active ? (
                    <strong>{TEXTS.activeBank}</strong>
                  ) : (
                    <OperatorsOnly otherwise={TEXTS.inactiveBank}>
                      <Button
                        size="compact-xs"
                        variant="default"
                        aria-label={fillText(TEXTS.activateBank, { bank: nameOf(bank) })}
                        disabled={locked !== null}
                        loading={activate.isPending && activate.variables === bank.id}
                        onClick={() => activate.mutate(bank.id)}
                      >
                        {TEXTS.activate}
                      </Button>
                    </OperatorsOnly>
                  )}
                </Table.Td>
                <Table.Td>
                  <a
                    href={`./api/banks/${bank.id}/file`}
                    download={`${bank.name}-v${bank.version}.json`}
                    aria-label={fillText(TEXTS.exportBank, { bank: nameOf(bank) })}
                  >
                    {TEXTS.export}
                  </a>
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </div>
      <Refusal error={activate.error} text={locked} />
    </>
  );
}

export function nameOf(bank: Bank): string {
  return fillText(TEXTS.bankAndVersion, { bank: bank.name, version: bank.version });
}
