/** What a person says of an event: a note, and tags as words. */

import { Button, TextInput } from "@mantine/core";
import { useState } from "react";
import { Refusal } from "../../components/Refusal";
import { useRemark } from "../../service/log";
import type { LogEntry } from "../../wire/types";
import styles from "./Log.module.css";

export function RemarkForm({ entry, onDone }: { entry: LogEntry; onDone: () => void }) {
  const [note, setNote] = useState(entry.note);
  const [tags, setTags] = useState(entry.tags.join(" "));
  const save = useRemark(entry.event as number);
  return (
    <form
      className={styles.form}
      aria-label="Note and tags"
      onSubmit={(event) => {
        event.preventDefault();
        save.mutate({ note, tags: tags.split(/\s+/).filter(Boolean) }, { onSuccess: onDone });
      }}
      onKeyDown={(event) => event.key === "Escape" && onDone()}
    >
      <TextInput
        aria-label="Note of the event"
        placeholder="Note"
        data-autofocus
        autoFocus
        value={note}
        onChange={(event) => setNote(event.currentTarget.value)}
      />
      <TextInput
        aria-label="Tags of the event"
        placeholder="tags, between blanks"
        value={tags}
        onChange={(event) => setTags(event.currentTarget.value)}
      />
      <Button type="submit" size="compact-sm" variant="default" loading={save.isPending}>
        Keep
      </Button>
      <Button size="compact-sm" variant="subtle" onClick={onDone}>
        Leave
      </Button>
      <Refusal error={save.error} about={`${note} ${tags}`} />
    </form>
  );
}
