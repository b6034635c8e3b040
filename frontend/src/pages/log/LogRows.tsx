import { ActionIcon, Button, Table, TextInput } from "@mantine/core";
import { memo, useState } from "react";
import { TbAlertTriangle, TbPencil } from "react-icons/tb";
import { Link } from "wouter";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { LocalizedText } from "../../components/values";
import { fixed, instant } from "../../samples/format";
import { localizeText } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { type LogKind, useRemark } from "../../service/api/log";
import { useAngleUnit } from "../../service/api/preferences";
import { isPlainRecord, isText, useDraft } from "../../service/forms/drafts";
import type { LogEntry } from "../../wire/types";
import page from "../Page.module.css";
import { addressOf } from "../runs/runAddress";
import styles from "./Log.module.css";
import { TEXTS } from "./texts";

/** Form for the note and the tags of an event. */

function isRemark(value: unknown): value is { note: string; tags: string } {
  return isPlainRecord(value) && isText(value.note) && isText(value.tags);
}

export function RemarkForm({ entry, onDone }: { entry: LogEntry; onDone: () => void }) {
  const stored = { note: entry.note, tags: entry.tags.join(" ") };
  const draft = useDraft(`remark on event ${entry.event}`, stored, isRemark);
  const { note, tags } = draft.value;
  const save = useRemark(entry.event as number);
  const set = (part: Partial<typeof stored>) => draft.set((before) => ({ ...before, ...part }));
  function close(): void {
    draft.discard();
    onDone();
  }
  return (
    <form
      className={styles.form}
      aria-label={TEXTS.noteAndTags}
      onSubmit={(event) => {
        event.preventDefault();
        save.mutate({ note, tags: tags.split(/\s+/).filter(Boolean) }, { onSuccess: close });
      }}
      onKeyDown={(event) => event.key === "Escape" && close()}
    >
      <TextInput
        aria-label={TEXTS.noteOfEvent}
        placeholder={TEXTS.note}
        data-autofocus
        autoFocus
        value={note}
        onChange={(event) => set({ note: event.currentTarget.value })}
      />
      <TextInput
        aria-label={TEXTS.tagsOfEvent}
        placeholder={TEXTS.tagsHint}
        value={tags}
        onChange={(event) => set({ tags: event.currentTarget.value })}
      />
      <Button type="submit" size="compact-sm" variant="default" loading={save.isPending}>
        {TEXTS.save}
      </Button>
      <Button size="compact-sm" variant="subtle" onClick={close}>
        {TEXTS.cancel}
      </Button>
      <Refusal error={save.error} about={`${note} ${tags}`} />
    </form>
  );
}

/** Filters of the log by kind. Pure. */

/** Names of the kinds; the type requires a name for each kind of the service. */
export const NAMES: Readonly<Record<LogKind, string>> = {
  mode: "Mode",
  tuning: "Tuning",
  bank: "Bank",
  fault: "Fault",
  references: "References",
  note: "Note",
  trip: "Trip",
  trigger: "Trigger",
  run: "Run",
  recording: "Recording",
  retention: "Storage of recordings",
  flight_quota: "Flight records",
  backup: "Backup",
  access: "Sign-in",
  refusal: "Refusal",
};

export const ALARMS: readonly LogKind[] = ["fault", "trip", "recording"];

/** Returns the kinds of a filter choice: "" for all, "alarms", or one kind. */
export function kindsOf(choice: string): readonly LogKind[] {
  if (choice === "alarms") return ALARMS;
  return isKind(choice) ? [choice] : [];
}

export const CHOICES = [
  { value: "", label: TEXTS.everything },
  { value: "alarms", label: TEXTS.alarms },
  ...Object.entries(NAMES).map(([value, label]) => ({
    value,
    label: value === "refusal" ? TEXTS.refusals : label,
  })),
];

/** Returns the start of a day in the local time zone, plus `days`, as ISO time; "" without a date. */
export function midnight(day: string, days = 0): string {
  const begin = new Date(`${day}T00:00`);
  if (Number.isNaN(begin.getTime())) return "";
  begin.setDate(begin.getDate() + days);
  return begin.toISOString();
}

function isKind(choice: string): choice is LogKind {
  return choice in NAMES;
}

/** Table of events: alarms have an icon, and each row links to its time in the recording. */

export function LogRows({ entries }: { entries: readonly LogEntry[] }) {
  return (
    <div className={page.tableScroll}>
      <Table aria-label={TEXTS.table} verticalSpacing={3} className={styles.rows ?? ""}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{TEXTS.time}</Table.Th>
            <Table.Th>{TEXTS.kind}</Table.Th>
            <Table.Th>{TEXTS.event}</Table.Th>
            <Table.Th>{TEXTS.person}</Table.Th>
            <Table.Th>{TEXTS.recording}</Table.Th>
            <Table.Th>{TEXTS.noteAndTags}</Table.Th>
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

/** Returns the key of a row; a run has one row for its start and one for its end. */
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
        {entry.who || <span className={page.dim}>{TEXTS.bySystem}</span>}
      </Table.Td>
      <Table.Td className={styles.when ?? ""}>
        <Recording entry={entry} />
      </Table.Td>
      <Table.Td className={styles.remark ?? ""}>
        {entry.event !== null && <RemarkLine entry={entry} />}
      </Table.Td>
    </Table.Tr>
  );
}, alike);

/** Whether two entries are equal, so that a refetch renders only changed rows. */
function alike(before: { entry: LogEntry }, now: { entry: LogEntry }): boolean {
  return before.entry === now.entry || JSON.stringify(before.entry) === JSON.stringify(now.entry);
}

function Recording({ entry: { run, t, flight, event, kind } }: { entry: LogEntry }) {
  return (
    <>
      {run !== null && (
        <Link href={addressOf(run, [], t)}>
          {t === null ? fillText(TEXTS.run, { run }) : fillText(TEXTS.runAt, { run, time: fixed(t, 3) })}
        </Link>
      )}
      {flight && (
        <>
          <Link className={styles.flight ?? ""} href={`/flights/${event}`}>
            {kind === "trigger" ? TEXTS.chartsOfTrigger : TEXTS.chartsOfTrip}
          </Link>
          <a className={styles.flight} href={`./api/flights/${event}/data.csv`} download>
            {TEXTS.flightRecord}
          </a>
        </>
      )}
    </>
  );
}

function RemarkLine({ entry }: { entry: LogEntry }) {
  const [writing, setWriting] = useState(false);
  const angles = useAngleUnit();
  if (writing) return <RemarkForm entry={entry} onDone={() => setWriting(false)} />;
  return (
    <span className={styles.noteLine}>
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
          aria-label={fillText(TEXTS.edit, { event: localizeText(entry.text, angles) })}
          onClick={() => setWriting(true)}
        >
          <TbPencil size={13} />
        </ActionIcon>
      </OperatorsOnly>
    </span>
  );
}
