/** Card with the storage that recordings use, and a dialog that deletes samples of old runs. */

import { Button, Modal, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { Verdict } from "../../components/RunState";
import { bytes, dateTime, spacedName } from "../../samples/format";
import { countThings, fillText } from "../../samples/texts";
import { recordingsQuery, useRemoveRecordings } from "../../service/api/recordings";
import type { Recordings } from "../../wire/types";
import { Facts } from "./Facts";
import styles from "./System.module.css";
import { TEXTS } from "./texts";

export function RecordingsCard() {
  const found = useQuery(recordingsQuery).data;
  /** List at the time the dialog opened, so that only runs that it shows are deleted. */
  const [asked, setAsked] = useState<Recordings["may_go"] | null>(null);
  const deletable = found?.may_go ?? [];
  return (
    <Facts
      title={TEXTS.recordings}
      facts={[
        [
          TEXTS.storageUsed,
          found && (
            <Verdict good={found.says === ""}>
              {fillText(TEXTS.usedOfLimit, {
                used: bytes(found.total_bytes),
                limit: bytes(found.limit_bytes),
              })}
            </Verdict>
          ),
        ],
        [TEXTS.inUse, found && fillText(TEXTS.inUseKept, { size: bytes(found.in_use_bytes) })],
        [
          TEXTS.deletable,
          found && (deletable.length === 0 ? TEXTS.deletableNone : summary(deletable, found.keep_days)),
        ],
      ]}
    >
      {deletable.length > 0 && (
        <div className={styles.actions}>
          <OperatorsOnly>
            <Button variant="default" onClick={() => setAsked(deletable)}>
              {TEXTS.choose}
            </Button>
          </OperatorsOnly>
        </div>
      )}
      <Modal opened={asked !== null} onClose={() => setAsked(null)} title={TEXTS.removal} size={720}>
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
  const [excluded, setExcluded] = useState<ReadonlySet<number>>(new Set());
  const remove = useRemoveRecordings();
  const selected = runs.filter((run) => !excluded.has(run.run));
  const toggle = (run: number) => setExcluded((before) => toggled(before, run));
  return (
    <>
      <p>{TEXTS.removalHint}</p>
      <Table.ScrollContainer minWidth={560} mah={360}>
        <Table>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{TEXTS.columnDelete}</Table.Th>
              <Table.Th>{TEXTS.columnRun}</Table.Th>
              <Table.Th>{TEXTS.columnStarted}</Table.Th>
              <Table.Th>{TEXTS.columnPerson}</Table.Th>
              <Table.Th>{TEXTS.columnNote}</Table.Th>
              <Table.Th className={styles.number}>{TEXTS.columnSamples}</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {runs.map((run) => (
              <Table.Tr key={run.run}>
                <Table.Td>
                  <input
                    type="checkbox"
                    aria-label={fillText(TEXTS.deleteRun, { run: run.run })}
                    checked={!excluded.has(run.run)}
                    onChange={() => toggle(run.run)}
                  />
                </Table.Td>
                <Table.Td>
                  {run.run}, {spacedName(run.kind)}
                </Table.Td>
                <Table.Td>{dateTime(run.started)}</Table.Td>
                <Table.Td>{run.who}</Table.Td>
                <Table.Td>{run.note || TEXTS.noNote}</Table.Td>
                <Table.Td className={styles.number}>{bytes(run.size_bytes)}</Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </Table.ScrollContainer>
      <div className={styles.actions}>
        <Button
          color="red"
          disabled={selected.length === 0}
          loading={remove.isPending}
          onClick={() =>
            remove.mutate(
              selected.map((run) => run.run),
              { onSuccess: onDone },
            )
          }
        >
          {fillText(TEXTS.deleteSamples, {
            runs: countThings(selected.length, "run"),
            size: bytes(total(selected)),
          })}
        </Button>
        <Button variant="default" onClick={onDone}>
          {TEXTS.keepAll}
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
  return fillText(TEXTS.deletableSummary, {
    runs: countThings(runs.length, "run"),
    age: countThings(keepDays, "day"),
    size: bytes(total(runs)),
  });
}
