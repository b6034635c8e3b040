/** Break a simulated plant on purpose: each fault with what brings it about, to see the reaction. */

import { Button, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Fragment, type ReactNode } from "react";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { Absent } from "../../components/values";
import { useLive } from "../../live/react";
import { faultsQuery, useEndInjection, useInjectFault } from "../../service/api/system";
import { useMayCommand } from "../../service/control/control";
import type { Injection, PlantView } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./System.module.css";

export default function DeveloperPage() {
  const { faults, card } = useQuery(faultsQuery).data ?? { faults: [], card: [] };
  const latched = useLive((live) => live.state?.fault?.code);
  const plant = useLive((live) => live.state?.plant);
  const breakable = plant?.simulated ?? true;
  const inject = useInjectFault();
  const mend = useEndInjection();
  return (
    <div className={page.page}>
      <h1 className={page.title}>Developer page</h1>
      <p className={page.lead}>
        {breakable
          ? `Break the ${plant?.name ?? "simulator"} while the joint moves, then mend it and reset the fault.`
          : `What is driven is no simulator but ${inSentence(plant)}: nothing is broken on purpose here.`}
      </p>
      <Card title="Faults">
        <OperatorsOnly>
          <div className={styles.actions}>
            <Button
              variant="default"
              disabled={!breakable}
              loading={mend.isPending}
              onClick={() => mend.mutate()}
            >
              Mend everything
            </Button>
            <Refusal error={inject.error ?? mend.error} />
          </div>
        </OperatorsOnly>
        <Breakable
          label="Faults"
          columns={["Fault", "Meaning", "Brought about by"]}
          rows={faults.map(({ code, message, injection, by_hand }) => ({
            name: code,
            cells: [
              <Fragment key="fault">
                <code>{code}</code>
                {latched === code && <strong> latched</strong>}
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
        <Card title="The card and its wires">
          <Breakable
            label="The card and its wires"
            columns={["Broken", "May end in"]}
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
                <span className={styles.hidden}>Action</span>
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
                    <Absent why="nothing that could be broken here brings it about" />
                  ) : (
                    <Button
                      size="compact-xs"
                      variant="default"
                      disabled={onInject === null}
                      aria-label={`Inject ${name}`}
                      onClick={() => onInject?.(injection)}
                    >
                      Inject
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
  if (plant?.kind === "package") return `the plant “${plant.name}” of a package`;
  return plant?.kind === "replay" ? "the replay of a recording" : "a rig";
}

const ABOUT_A_SENSOR = new Set([
  "no_number",
  "stuck",
  "jump",
  "drift_up",
  "drift_down",
  "saturation",
  "lost_counts",
]);

function described({ kind, sensor }: Injection): string {
  const words = kind.replaceAll("_", " ");
  return ABOUT_A_SENSOR.has(kind) ? `${words} of ${sensor.replace("theta", "θ")}` : words;
}
