/** Asks once for the person's name; without it, everyone who uses the sign-in link has the role as name. */

import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { type FormEvent, useState } from "react";
import { fillText } from "../samples/texts";
import { usePreferences } from "../service/api/preferences";
import { sessionQuery, useSetName } from "../service/api/session";
import { RefusedFields } from "../service/forms/refusals";
import { readStored, storeText } from "../wire/browserStorage";
import { TextField } from "./fields";
import styles from "./NameQuestion.module.css";
import { Refusal } from "./Refusal";
import { TEXTS } from "./texts";

/** Storage key of this browser for persons without a name. */
const DECLINED_KEY = "sinew-goes-by-role";

interface NameQuestionProps {
  /** Whether the person requests a change of the name. */
  readonly wanted: boolean;
  onDone(): void;
}

export function NameQuestion({ wanted, onDone }: NameQuestionProps) {
  const session = useQuery(sessionQuery);
  const [isDeclined, setDeclined] = useState(() => readStored("localStorage", DECLINED_KEY) !== null);
  const [name, setName] = useState("");
  const set = useSetName();
  const { preferences, known } = usePreferences();
  // One bar at a time: a new person sees the tour first.
  const isInTour = !known || !preferences.toured;
  const isRequired = session.data?.asks_name === true && !isDeclined && !isInTour;
  if (session.data === undefined || !(wanted || isRequired)) return null;
  const role = session.data.role;

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (name.trim() !== "") set.mutate(name, { onSuccess: onDone });
  }

  function close(): void {
    storeText("localStorage", DECLINED_KEY, role);
    setDeclined(true);
    onDone();
  }

  return (
    <RefusedFields error={set.error} about={name} only="name">
      <form className={styles.question} aria-label={TEXTS.yourName} onSubmit={submit}>
        <label className={styles.label} htmlFor="own-name">
          {wanted ? TEXTS.nameWanted : fillText(TEXTS.nameAsked, { role })}
        </label>
        <TextField
          id="own-name"
          name="name"
          messageId="refusal-of-name"
          size="xs"
          w={180}
          maxLength={40}
          autoComplete="name"
          value={name}
          onChange={setName}
        />
        <Button type="submit" size="compact-sm" disabled={name.trim() === ""} loading={set.isPending}>
          {TEXTS.saveName}
        </Button>
        <Button size="compact-sm" variant="subtle" color="gray" onClick={close}>
          {wanted ? TEXTS.keepName : fillText(TEXTS.continueAs, { role })}
        </Button>
        <div className={styles.refusal}>
          <Refusal id="refusal-of-name" error={set.error} forFields about={name} hint={TEXTS.nameHint} />
        </div>
      </form>
    </RefusedFields>
  );
}
