/** What a person says of an event: a note, and tags as words. */

import { Button, TextInput } from "@mantine/core";
import { Refusal } from "../../components/Refusal";
import { isPlainRecord, isText, useDraft } from "../../service/drafts";
import { useRemark } from "../../service/log";
import type { LogEntry } from "../../wire/types";
import styles from "./Log.module.css";

function isRemark(value: unknown): value is { note: string; tags: string } {
  return isPlainRecord(value) && isText(value.note) && isText(value.tags);
}

export function RemarkForm({ entry, onDone }: { entry: LogEntry; onDone: () => void }) {
  const kept = { note: entry.note, tags: entry.tags.join(" ") };
  const draft = useDraft(`remark on event ${entry.event}`, kept, isRemark);
  const { note, tags } = draft.value;
  const save = useRemark(entry.event as number);
  const set = (part: Partial<typeof kept>) => draft.set((before) => ({ ...before, ...part }));
  function close(): void {
    draft.discard();
    onDone();
  }
  return (
    <form
      className={styles.form}
      aria-label="Note and tags"
      onSubmit={(event) => {
        event.preventDefault();
        save.mutate({ note, tags: tags.split(/\s+/).filter(Boolean) }, { onSuccess: close });
      }}
      onKeyDown={(event) => event.key === "Escape" && close()}
    >
      <TextInput
        aria-label="Note of the event"
        placeholder="Note"
        data-autofocus
        autoFocus
        value={note}
        onChange={(event) => set({ note: event.currentTarget.value })}
      />
      <TextInput
        aria-label="Tags of the event"
        placeholder="tags, between blanks"
        value={tags}
        onChange={(event) => set({ tags: event.currentTarget.value })}
      />
      <Button type="submit" size="compact-sm" variant="default" loading={save.isPending}>
        Keep
      </Button>
      <Button size="compact-sm" variant="subtle" onClick={close}>
        Leave
      </Button>
      <Refusal error={save.error} about={`${note} ${tags}`} />
    </form>
  );
}
