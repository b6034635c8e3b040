/** Injects faults into a simulated plant and shows each fault with its injection. */

import { Button, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Fragment, type ReactNode } from "react";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { Absent } from "../../components/values";
import { useLive } from "../../live/react";
import { spacedName } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { faultsQuery, useEndInjection, useInjectFault } from "../../service/api/system";
import { useMayCommand } from "../../service/control/control";
import type { Injection, PlantView } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./System.module.css";
import { TEXTS } from "./texts";

export default function DeveloperPage() {
  const { faults, card } = useQuery(faultsQuery).data ?? { faults: [], card: [] };
  const latched = useLive((live) => live.state?.fault?.code);
  const plant = useLive((live) => live.state?.plant);
  const injectable = plant?.simulated ?? true;
  const inject = useInjectFault();
  const clear = useEndInjection();
  return (
    <div className={page.page}>
      <h1 className={page.title}>{TEXTS.developer}</h1>
      <p className={page.lead}>
        {injectable
          ? fillText(TEXTS.developerHint, { plant: plant?.name ?? TEXTS.simulatorName })
          : fillText(TEXTS.notInjectable, { plant: inSentence(plant) })}
      </p>
      <Card title={TEXTS.faults}>
        <OperatorsOnly>
          <div className={styles.actions}>
            <Button
              variant="default"
              disabled={!injectable}
              loading={clear.isPending}
              onClick={() => clear.mutate()}
            >
              {TEXTS.clearAll}
            </Button>
            <Refusal error={inject.error ?? clear.error} />
          </div>
        </OperatorsOnly>
        <InjectionTable
          label={TEXTS.faults}
          columns={[TEXTS.columnFault, TEXTS.columnMeaning, TEXTS.columnInjection]}
          rows={faults.map(({ code, message, injection, by_hand }) => ({
            name: code,
            cells: [
              <Fragment key="fault">
                <code>{code}</code>
                {latched === code && <strong> {TEXTS.latched}</strong>}
              </Fragment>,
              message,
              injection === null ? by_hand : described(injection),
            ],
            injection,
          }))}
          onInject={injectable ? inject.mutate : null}
        />
      </Card>
      {card.length > 0 && (
        <Card title={TEXTS.card}>
          <InjectionTable
            label={TEXTS.card}
            columns={[TEXTS.columnDefect, TEXTS.columnLeadsTo]}
            rows={card.map(({ injection, says, leads_to }) => ({
              name: says,
              cells: [says, <Codes key="faults" codes={leads_to} />],
              injection,
            }))}
            onInject={inject.mutate}
          />
        </Card>
      )}
    </div>
  );
}

interface InjectionTableProps {
  readonly label: string;
  readonly columns: readonly string[];
  /** Name for the button, a cell per column, and the injection; null if the fault has none. */
  readonly rows: readonly {
    readonly name: string;
    readonly cells: readonly ReactNode[];
    readonly injection: Injection | null;
  }[];
  /** null if the plant does not support fault injection. */
  readonly onInject: ((injection: Injection) => void) | null;
}

/** Table of faults or defects; an operator has a button for each injection. */
function InjectionTable({ label, columns, rows, onInject }: InjectionTableProps) {
  const may = useMayCommand() !== false;
  return (
    <div className={page.tableScroll}>
      <Table aria-label={label} verticalSpacing={4}>
        <Table.Thead>
          <Table.Tr>
            {columns.map((column) => (
              <Table.Th key={column}>{column}</Table.Th>
            ))}
            {may && (
              <Table.Th>
                <span className={styles.hidden}>{TEXTS.columnAction}</span>
              </Table.Th>
            )}
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {rows.map(({ name, cells, injection }) => (
            <Table.Tr key={name}>
              {columns.map((column, position) => (
                <Table.Td key={column}>{cells[position]}</Table.Td>
              ))}
              {may && (
                <Table.Td>
                  {injection === null ? (
                    <Absent why={TEXTS.noInjection} />
                  ) : (
                    <Button
                      size="compact-xs"
                      variant="default"
                      disabled={onInject === null}
                      aria-label={fillText(TEXTS.injectNamed, { name })}
                      onClick={() => onInject?.(injection)}
                    >
                      {TEXTS.inject}
                    </Button>
                  )}
                </Table.Td>
              )}
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}

function Codes({ codes }: { codes: readonly string[] }) {
  return codes.map((code, position) => (
    <Fragment key={code}>
      {position > 0 && ", "}
      <code>{code}</code>
    </Fragment>
  ));
}

function inSentence(plant: PlantView | undefined): string {
  if (plant?.kind === "package") return fillText(TEXTS.plantOfPackage, { name: plant.name });
  return plant?.kind === "replay" ? TEXTS.replay : TEXTS.rig;
}

/** Injections into one sensor. */
const SENSOR_TEXTS = {
  no_number: TEXTS.invalidReading,
  stuck: TEXTS.stuck,
  jump: TEXTS.jump,
  drift_up: TEXTS.driftUp,
  drift_down: TEXTS.driftDown,
  saturation: TEXTS.saturation,
  lost_counts: TEXTS.lostCounts,
} as const;

function isAboutSensor(kind: Injection["kind"]): kind is keyof typeof SENSOR_TEXTS {
  return kind in SENSOR_TEXTS;
}

function described({ kind, sensor }: Injection): string {
  if (isAboutSensor(kind)) return fillText(SENSOR_TEXTS[kind], { sensor: sensor.replace("theta", "θ") });
  return spacedName(kind);
}
