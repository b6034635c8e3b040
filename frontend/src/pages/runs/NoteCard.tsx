/** What a person wants to remember of a run, and what can be taken away of it. */

import { Button, Textarea } from "@mantine/core";
import { useState } from "react";
import { Card } from "../../components/Card";
import { Downloads } from "../../components/Downloads";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { useSetNote } from "../../service/commands";
import { RefusedFields, useRefusedInput } from "../../service/refusedFields";
import { useMayCommand } from "../../service/useMayCommand";
import type { Run } from "../../wire/types";
import page from "../Page.module.css";

export function NoteCard({ run }: { run: Run }) {
  const [note, setNote] = useState(run.note);
  const save = useSetNote(run.id);
  return (
    <Card title="Note and downloads">
      <RefusedFields error={save.error} about={note} only="note">
        <div className={page.fields}>
          <NoteField value={note} onChange={setNote} />
          <div className={page.actions}>
            <OperatorsOnly>
              <Button
                variant="default"
                disabled={note === run.note}
                loading={save.isPending}
                onClick={() => save.mutate(note)}
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
