/** What a person wants to remember of a run, and what can be taken away of it. */

import { Button, Textarea } from "@mantine/core";
import { Card } from "../../components/Card";
import { Downloads } from "../../components/Downloads";
import { DraftMark } from "../../components/DraftMark";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { useSetNote } from "../../service/commands";
import { RefusedFields, useRefusedInput } from "../../service/refusedFields";
import { isText, useDraft } from "../../service/useDraft";
import { useMayCommand } from "../../service/useMayCommand";
import type { Run } from "../../wire/types";
import page from "../Page.module.css";

export function NoteCard({ run }: { run: Run }) {
  const draft = useDraft(`note of run ${run.id}`, run.note, isText);
  const note = draft.value;
  const save = useSetNote(run.id);
  return (
    <Card title="Note and downloads">
      <RefusedFields error={save.error} about={note} only="note">
        <div className={page.fields}>
          <NoteField value={note} onChange={draft.set} />
          <DraftMark draft={draft} of="note" back="The saved note comes back." onDiscard={draft.discard} />
          <div className={page.actions}>
            <OperatorsOnly>
              <Button
                variant="default"
                disabled={note === run.note}
                loading={save.isPending}
                onClick={() => save.mutate(note, { onSuccess: draft.discard })}
              >
                Save note
              </Button>
            </OperatorsOnly>
            <Refusal error={save.error} about={note} />
          </div>
          <div className={page.actions}>
            <Downloads run={run.id} report={run.end_state !== "running"} />
          </div>
        </div>
      </RefusedFields>
    </Card>
  );
}

function NoteField({ value, onChange }: { value: string; onChange: (value: string) => void }) {
  const { ref, said } = useRefusedInput<HTMLTextAreaElement>("note");
  return (
    <Textarea
      label="Note"
      autosize
      minRows={2}
      maxRows={6}
      value={value}
      ref={ref}
      error={said}
      readOnly={useMayCommand() === false}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}
