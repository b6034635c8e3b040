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
  const breakable = plant?.simulated ?? true;
  const inject = useInjectFault();
  const mend = useEndInjection();
  return (
    <div className={page.page}>
      <h1 className={page.title}>{TEXTS.developer}</h1>
      <p className={page.lead}>
        {breakable
          ? fillText(TEXTS.developerHint, { plant: plant?.name ?? TEXTS.simulatorName })
          : fillText(TEXTS.notInjectable, { plant: inSentence(plant) })}
      </p>
      <Card title={TEXTS.faults}>
        <OperatorsOnly>
          <div className={styles.actions}>
            <Button
              variant="default"
              disabled={!breakable}
              loading={mend.isPending}
              onClick={() => mend.mutate()}
            >
              {TEXTS.clearAll}
            </Button>
            <Refusal error={inject.error ?? mend.error} />
          </div>
        </OperatorsOnly>
        <Breakable
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
          onInject={breakable ? inject.mutate : null}
        />
      </Card>
      {card.length > 0 && (
        <Card title={TEXTS.card}>
          <Breakable
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

interface BreakableProps {
  readonly label: string;
  readonly columns: readonly string[];
  /** A name for the button, a cell for each column, and what to break; null where nothing has to be broken for it. */
  readonly rows: readonly {
    readonly name: string;
    readonly cells: readonly ReactNode[];
    readonly injection: Injection | null;
  }[];
  /** Null where nothing can be broken. */
  readonly onInject: ((injection: Injection) => void) | null;
}

/** What can be broken, each with a button for whoever may. */
function Breakable({ label, columns, rows, onInject }: BreakableProps) {
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
