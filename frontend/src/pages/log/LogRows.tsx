/** The log as a table: alarms with icon and word, each line linked to its second of the recording. */

import { ActionIcon, Table } from "@mantine/core";
import { memo, useState } from "react";
import { TbAlertTriangle, TbPencil } from "react-icons/tb";
import { Link } from "wouter";
import { LocalizedText } from "../../components/LocalizedText";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { fixed, instant } from "../../samples/format";
import { inWords } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import type { LogEntry } from "../../wire/types";
import page from "../Page.module.css";
import { addressOf } from "../runs/address";
import { ALARMS, NAMES } from "./kinds";
import styles from "./Log.module.css";
import { RemarkForm } from "./RemarkForm";

export function LogRows({ entries }: { entries: readonly LogEntry[] }) {
  return (
    <div className={page.tableScroll}>
      <Table aria-label="Log" verticalSpacing={3} className={styles.rows ?? ""}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>When</Table.Th>
            <Table.Th>Kind</Table.Th>
            <Table.Th>What happened</Table.Th>
            <Table.Th>Who</Table.Th>
            <Table.Th>Recording</Table.Th>
            <Table.Th>Note and tags</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {entries.map((entry) => (
            <Row key={keyOf(entry)} entry={entry} />
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}

/** A run has a line for its begin and one for its end. */
function keyOf({ event, run, at }: LogEntry): string {
  return event === null ? `run ${run} ${at}` : String(event);
}

const Row = memo(({ entry }: { entry: LogEntry }) => {
  const alarm = ALARMS.includes(entry.kind);
  return (
    <Table.Tr data-alarm={alarm} className={styles.row ?? ""}>
      <Table.Td className={styles.when ?? ""}>{instant(entry.at)}</Table.Td>
      <Table.Td className={styles.kind ?? ""}>
        {alarm && <TbAlertTriangle size={14} aria-hidden="true" />} {NAMES[entry.kind]}
      </Table.Td>
      <Table.Td className={styles.text ?? ""}>
        <LocalizedText text={entry.text} />
      </Table.Td>
      <Table.Td className={styles.who ?? ""}>
        {entry.who || <span className={page.dim}>by itself</span>}
      </Table.Td>
      <Table.Td className={styles.when ?? ""}>
        <Recording entry={entry} />
      </Table.Td>
      <Table.Td className={styles.remark ?? ""}>{entry.event !== null && <Said entry={entry} />}</Table.Td>
    </Table.Tr>
  );
}, alike);

/** Asked for again and again, most lines stay what they are: only what changed is drawn anew. */
function alike(before: { entry: LogEntry }, now: { entry: LogEntry }): boolean {
  return before.entry === now.entry || JSON.stringify(before.entry) === JSON.stringify(now.entry);
}

function Recording({ entry: { run, t, flight, event, kind } }: { entry: LogEntry }) {
  return (
    <>
      {run !== null && (
        <Link href={addressOf(run, [], t)}>
          Run {run}
          {t !== null && ` at ${fixed(t, 3)} s`}
        </Link>
      )}
      {flight && (
        <>
          <Link className={styles.flight ?? ""} href={`/flights/${event}`}>
            charts of the {kind === "trigger" ? "trigger" : "trip"}
          </Link>
          <a className={styles.flight} href={`./api/flights/${event}/data.csv`} download>
            flight record
          </a>
        </>
      )}
    </>
  );
}

function Said({ entry }: { entry: LogEntry }) {
  const [writing, setWriting] = useState(false);
  const angles = useAngles();
  if (writing) return <RemarkForm entry={entry} onDone={() => setWriting(false)} />;
  return (
    <span className={styles.said}>
      {entry.note !== "" && <span>{entry.note}</span>}
      {entry.tags.map((tag) => (
        <span key={tag} className={styles.tag}>
          {tag}
        </span>
      ))}
      {entry.remark_by !== "" && <span className={page.dim}>{entry.remark_by}</span>}
      <OperatorsOnly>
        <ActionIcon
          size={20}
          variant="subtle"
          color="gray"
          aria-label={`Say something of: ${inWords(entry.text, angles)}`}
          onClick={() => setWriting(true)}
        >
          <TbPencil size={13} />
        </ActionIcon>
      </OperatorsOnly>
    </span>
  );
}
