/** Reason why a value was refused; its space is reserved, so that the page does not move when it appears. */

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

/** Takes control for this page, also from its current holder. */

export function TakeControl(style: Pick<ButtonProps, "variant" | "color">) {
  const holder = useLive((live) => live.state?.holder?.name ?? null);
  const take = useMutation({ mutationFn: () => answeredBy(takeControl(true)) });
  const refused = useErrorLifetime(take.error);
  return (
    <>
      <Button
        size="compact-xs"
        variant="default"
        {...style}
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
  /** Shown until its cause is gone. */
  readonly error?: Error | null | undefined;
  /** Active values that the refused request would have changed; a change of them ends the refusal. */
  readonly about?: unknown;
  /** Id that the described input refers to. */
  readonly id?: string;
  /** Reason that the page itself knows. */
  readonly text?: string | null | undefined;
  /** Whether it shows refusals of fields that have no space for a message. */
  readonly forFields?: boolean;
  /** Shown while there is no refusal. */
  readonly hint?: string;
  /** Control that removes the cause of `text`; a response of the service has its own. */
  readonly children?: ReactNode;
}

export function Refusal({ error, about, id, text, forFields = false, hint = "", children }: RefusalProps) {
  const active = useErrorLifetime(error, about);
  const angles = useAngleUnit();
  const isAtField = useShownAtField(active) && !forFields;
  const message = active === null ? text : isAtField ? null : active.message;
  const refused = message !== null && message !== undefined;
  const noControl = useWhyNoControl();
  const offersControl = active === null ? refused && message === noControl : isAboutControl(active);
  const reason = refused ? localizeText(message, angles) : undefined;
  return (
    <output
      id={id}
      className={styles.refusal}
      aria-label={TEXTS.refusal}
      data-refused={refused}
      title={refused ? localizeText(active?.message ?? message, angles) : undefined}
    >
      {refused ? reason : hint}
      {offersControl && (
        <>
          {" "}
          <TakeControl />
        </>
      )}
      {refused && active === null && !offersControl && children}
    </output>
  );
}
