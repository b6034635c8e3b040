/** The tags of a run: put on, taken off, and led on to the runs that have them too. */

import { ActionIcon, Button, TextInput } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useId } from "react";
import { TbX } from "react-icons/tb";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { useTag } from "../../service/commands";
import { searchWordsQuery } from "../../service/queries";
import { isText, useDraft } from "../../service/useDraft";
import type { Run } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./Runs.module.css";

export function Tags({ run }: { run: Run }) {
  const draft = useDraft(`tag of run ${run.id}`, "", isText);
  const typed = draft.value;
  const change = useTag(run.id);
  const words = useQuery(searchWordsQuery);
  const known = useId();
  function put(): void {
    if (typed.trim() !== "") {
      change.mutate({ tag: typed.trim(), put: true }, { onSuccess: draft.discard });
    }
  }
  return (
    <div className={page.fields}>
      <ul className={styles.tags} aria-label="Tags">
        {run.tags.length === 0 && <li className={page.dim}>no tags</li>}
        {run.tags.map((tag) => (
          <li key={tag} className={styles.tag}>
            {tag}
            <OperatorsOnly>
              <ActionIcon
                size={16}
                variant="subtle"
                color="gray"
                aria-label={`Take off ${tag}`}
                onClick={() => change.mutate({ tag, put: false })}
              >
                <TbX size={11} />
              </ActionIcon>
            </OperatorsOnly>
          </li>
        ))}
      </ul>
      <OperatorsOnly>
        <form
          className={page.actions}
          onSubmit={(event) => {
            event.preventDefault();
            put();
          }}
        >
          <TextInput
            aria-label="New tag"
            placeholder="New tag"
            list={known}
            value={typed}
            w={160}
            onChange={(event) => draft.set(event.currentTarget.value)}
          />
          <datalist id={known}>
            {words.data?.tags.map((tag) => (
              <option key={tag} value={tag} />
            ))}
          </datalist>
          <Button type="submit" variant="default" disabled={typed.trim() === ""} loading={change.isPending}>
            Add tag
          </Button>
          <Refusal error={change.error} about={typed} />
        </form>
      </OperatorsOnly>
    </div>
  );
}
