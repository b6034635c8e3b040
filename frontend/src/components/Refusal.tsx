/** Room kept free for the reason why a value was refused, so that nothing moves when there is one. */

import { Button, type ButtonProps } from "@mantine/core";
import { useMutation } from "@tanstack/react-query";
import type { ReactNode } from "react";
import { useLive } from "../live/react";
import { localizeText } from "../samples/quantity";
import { fillText } from "../samples/texts";
import { useAngleUnit } from "../service/api/preferences";
import { useWhyNoControl } from "../service/control/control";
import { isAboutControl, useErrorLifetime, useShownAtField } from "../service/forms/refusals";
import { answeredBy } from "../wire/client";
import { takeControl } from "../wire/control";
import styles from "./Refusal.module.css";
import { TEXTS } from "./texts";

/** Takes control of the actuator for this page, from whoever holds it. */

export function TakeControl(look: Pick<ButtonProps, "variant" | "color">) {
  const holder = useLive((live) => live.state?.holder?.name ?? null);
  const take = useMutation({ mutationFn: () => answeredBy(takeControl(true)) });
  const refused = useErrorLifetime(take.error);
  return (
    <>
      <Button
        size="compact-xs"
        variant="default"
        {...look}
        loading={take.isPending}
        title={holder === null ? undefined : fillText(TEXTS.losesControl, { name: holder })}
        onClick={() => take.mutate()}
      >
        {TEXTS.takeControl}
      </Button>
      {refused !== null && <span> {refused.message}</span>}
    </>
  );
}

interface RefusalProps {
  /** Shown until what caused it is gone. */
  readonly error?: Error | null | undefined;
  /** What the refused request would have changed, as it is in force: once that changes, the refusal is over. */
  readonly about?: unknown;
  /** For the box that it speaks of. */
  readonly id?: string;
  /** What keeps something from being done, found here and now. */
  readonly text?: string | null | undefined;
  /** Whether it speaks for fields that have no room to say so themselves. */
  readonly forFields?: boolean;
  /** Shown while nothing is refused. */
  readonly hint?: string;
  /** What removes the cause of `text`, one press away; an answer of the service has its own. */
  readonly children?: ReactNode;
}

export function Refusal({ error, about, id, text, forFields = false, hint = "", children }: RefusalProps) {
  const standing = useErrorLifetime(error, about);
  const angles = useAngleUnit();
  const elsewhere = useShownAtField(standing) && !forFields;
  const said = standing === null ? text : elsewhere ? null : standing.message;
  const refused = said !== null && said !== undefined;
  const noControl = useWhyNoControl();
  const offersControl = standing === null ? refused && said === noControl : isAboutControl(standing);
  const reason = refused ? localizeText(said, angles) : undefined;
  return (
    <output
      id={id}
      className={styles.refusal}
      aria-label={TEXTS.refusal}
      data-refused={refused}
      title={refused ? localizeText(standing?.message ?? said, angles) : undefined}
    >
      {refused ? reason : hint}
      {offersControl && (
        <>
          {" "}
          <TakeControl />
        </>
      )}
      {refused && standing === null && !offersControl && children}
    </output>
  );
}
