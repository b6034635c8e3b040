/** Break a simulated plant on purpose: each fault with what brings it about, to see the reaction. */

import { Button, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Absent } from "../../components/Absent";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { useLive } from "../../live/react";
import { faultsQuery, useInject, useMend } from "../../service/system";
import { useMayCommand } from "../../service/useMayCommand";
import type { Injection, PlantView } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./System.module.css";

export default function DeveloperPage() {
  const { faults, card } = useQuery(faultsQuery).data ?? { faults: [], card: [] };
  const latched = useLive((live) => live.state?.fault?.code);
  const plant = useLive((live) => live.state?.plant);
  const breakable = plant?.simulated ?? true;
  const inject = useInject();
  const mend = useMend();
  const may = useMayCommand() !== false;
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
        <div className={page.tableScroll}>
          <Table aria-label="Faults" verticalSpacing={4}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>Fault</Table.Th>
                <Table.Th>Meaning</Table.Th>
                <Table.Th>Brought about by</Table.Th>
                {may && (
                  <Table.Th>
                    <span className={styles.hidden}>Action</span>
                  </Table.Th>
                )}
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {faults.map(({ code, message, injection, by_hand }) => (
                <Table.Tr key={code}>
                  <Table.Td>
                    <code>{code}</code>
                    {latched === code && <strong> latched</strong>}
                  </Table.Td>
                  <Table.Td>{message}</Table.Td>
                  <Table.Td>{injection === null ? by_hand : described(injection)}</Table.Td>
                  {may && (
                    <Table.Td>
                      {injection === null ? (
                        <Absent why="only brought about by hand" />
                      ) : (
                        <Button
                          size="compact-xs"
                          variant="default"
                          disabled={!breakable}
                          aria-label={`Inject ${code}`}
                          onClick={() => inject.mutate(injection)}
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
      </Card>
      {card.length > 0 && (
        <Card title="The card and its wires">
          <div className={page.tableScroll}>
            <Table aria-label="The card and its wires" verticalSpacing={4}>
              <Table.Thead>
                <Table.Tr>
                  <Table.Th>Broken</Table.Th>
                  <Table.Th>May end in</Table.Th>
                  {may && (
                    <Table.Th>
                      <span className={styles.hidden}>Action</span>
                    </Table.Th>
                  )}
                </Table.Tr>
              </Table.Thead>
              <Table.Tbody>
                {card.map(({ injection, says, leads_to }) => (
                  <Table.Tr key={says}>
                    <Table.Td>{says}</Table.Td>
                    <Table.Td>
                      {leads_to.map((code, position) => (
                        <span key={code}>
                          {position > 0 && ", "}
                          <code>{code}</code>
                        </span>
                      ))}
                    </Table.Td>
                    {may && (
                      <Table.Td>
                        <Button
                          size="compact-xs"
                          variant="default"
                          aria-label={`Inject ${says}`}
                          onClick={() => inject.mutate(injection)}
                        >
                          Inject
                        </Button>
                      </Table.Td>
                    )}
                  </Table.Tr>
                ))}
              </Table.Tbody>
            </Table>
          </div>
        </Card>
      )}
    </div>
  );
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
