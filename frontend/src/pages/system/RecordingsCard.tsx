/** Room that recordings take; where it is too much, which samples may go, and deleting exactly those. */

import { Button, Modal, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { Verdict } from "../../components/RunState";
import { bytes, dateTime, pluralized, spacedName } from "../../samples/format";
import { recordingsQuery, useRemoveRecordings } from "../../service/api/recordings";
import type { Recordings } from "../../wire/types";
import { Facts } from "./Facts";
import styles from "./System.module.css";

export function RecordingsCard() {
  const found = useQuery(recordingsQuery).data;
  /** The list as it was when the dialog was opened: what is shown is what goes. */
  const [asked, setAsked] = useState<Recordings["may_go"] | null>(null);
  const mayGo = found?.may_go ?? [];
  return (
    <Facts
      title="Recordings"
      facts={[
        [
          "Room taken",
          found && (
            <Verdict good={found.says === ""}>
              {bytes(found.total_bytes)} of {bytes(found.limit_bytes)}
            </Verdict>
          ),
        ],
        ["In use", found && `${bytes(found.in_use_bytes)} that models, results or reports came from stay`],
        ["May go", found && (mayGo.length === 0 ? "nothing has to go" : summary(mayGo, found.keep_days))],
      ]}
    >
      {mayGo.length > 0 && (
        <div className={styles.actions}>
          <OperatorsOnly>
            <Button variant="default" onClick={() => setAsked(mayGo)}>
              Choose what goes
            </Button>
          </OperatorsOnly>
        </div>
      )}
      <Modal opened={asked !== null} onClose={() => setAsked(null)} title="Delete samples" size={720}>
        {asked !== null && <Removal runs={asked} onDone={() => setAsked(null)} />}
      </Modal>
    </Facts>
  );
}

interface RemovalProps {
  readonly runs: Recordings["may_go"];
  onDone(): void;
}

function Removal({ runs, onDone }: RemovalProps) {
  const [kept, setKept] = useState<ReadonlySet<number>>(new Set());
  const remove = useRemoveRecordings();
  const going = runs.filter((run) => !kept.has(run.run));
  const toggle = (run: number) => setKept((before) => toggled(before, run));
  return (
    <>
      <p>
        The samples of the runs ticked here are deleted for good. The runs stay, with their settings and
        notes. A backup made before has the samples still.
      </p>
      <Table.ScrollContainer minWidth={560} mah={360}>
        <Table>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>Delete</Table.Th>
              <Table.Th>Run</Table.Th>
              <Table.Th>Started</Table.Th>
              <Table.Th>By</Table.Th>
              <Table.Th>Note</Table.Th>
              <Table.Th className={styles.number}>Samples</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {runs.map((run) => (
              <Table.Tr key={run.run}>
                <Table.Td>
                  <input
                    type="checkbox"
                    aria-label={`Delete the samples of run ${run.run}`}
                    checked={!kept.has(run.run)}
                    onChange={() => toggle(run.run)}
                  />
                </Table.Td>
                <Table.Td>
                  {run.run}, {spacedName(run.kind)}
                </Table.Td>
                <Table.Td>{dateTime(run.started)}</Table.Td>
                <Table.Td>{run.who}</Table.Td>
                <Table.Td>{run.note || "no note"}</Table.Td>
                <Table.Td className={styles.number}>{bytes(run.size_bytes)}</Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </Table.ScrollContainer>
      <div className={styles.actions}>
        <Button
          color="red"
          disabled={going.length === 0}
          loading={remove.isPending}
          onClick={() =>
            remove.mutate(
              going.map((run) => run.run),
              { onSuccess: onDone },
            )
          }
        >
          {`Delete the samples of ${pluralized(going.length, "run")} (${bytes(total(going))})`}
        </Button>
        <Button variant="default" onClick={onDone}>
          Keep all
        </Button>
        <Refusal error={remove.error} />
      </div>
    </>
  );
}

function toggled(numbers: ReadonlySet<number>, number: number): ReadonlySet<number> {
  const after = new Set(numbers);
  if (!after.delete(number)) after.add(number);
  return after;
}

function total(runs: Recordings["may_go"]): number {
  return runs.reduce((sum, run) => sum + run.size_bytes, 0);
}

function summary(runs: Recordings["may_go"], keepDays: number): string {
  return `samples of ${pluralized(runs.length, "run")} older than ${pluralized(keepDays, "day")}, ${bytes(total(runs))}`;
}
