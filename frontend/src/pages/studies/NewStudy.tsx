import { Button, FileButton, Textarea } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect, useState } from "react";
import { useLocation } from "wouter";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { DraftMark, useReplaceDraft } from "../../components/DraftMark";
import { Refusal } from "../../components/Refusal";
import { countThings, fillText } from "../../samples/texts";
import { checkedStudyQuery, useBeginStudy } from "../../service/api/studies";
import { isText, useDraft } from "../../service/forms/drafts";
import type { CheckedStudy } from "../../wire/types";
import page from "../Page.module.css";
import { asStudy, EMPTY_STUDY, type StudyDocument, StudyForm, writeStudy } from "./StudyForm";
import { TEXTS } from "./texts";

/** Checks the text of a study with the service once nobody has typed for REST_MS. */

const REST_MS = 400;

/** Returns the check of exactly this text; null until it is known, and for an empty text. */
function useCheckedStudy(text: string): CheckedStudy | null {
  const [rested, rest] = useState(text);
  useEffect(() => {
    const timer = setTimeout(() => rest(text), REST_MS);
    return () => clearTimeout(timer);
  }, [text]);
  const { data } = useQuery({ ...checkedStudyQuery(rested), enabled: rested.trim() !== "" });
  return rested === text && data !== undefined ? data : null;
}

/** Card that creates a study with a form and its text; an edit of one changes the other. */

const FILES = ".yaml,.yml,.json,application/yaml,application/json";
const EXAMPLE = `format: 1
name: lambda_map
title: Tracking vs λ_q, λ_S with plant variation
experiment: tracking
settings: {motion: lambda}
axes:
  - {over: lam_q, first: 0.4, last: 1.0, count: 5}
  - {over: lam_S, first: 0.4, last: 1.0, count: 5}
spread:
  - {of: motor.c0, relative: 0.2}
draws: 4
`;

export function NewStudy() {
  const draft = useDraft("study", "", isText);
  const text = draft.value;
  const [guard, question] = useReplaceDraft(draft.since !== null);
  const begin = useBeginStudy();
  const checked = useCheckedStudy(text);
  // text that the form has written is shown without a check by the service
  const [shown, show] = useState<{ readonly text: string; readonly document: StudyDocument } | null>(null);
  const parsed = asStudy(checked?.document);
  const document = shown?.text === text ? shown.document : parsed;
  const [, go] = useLocation();

  function change(next: string): void {
    draft.set(next);
    begin.reset();
  }

  function edit(next: StudyDocument): void {
    const written = writeStudy(next);
    show({ text: written, document: next });
    change(written);
  }

  async function read(file: File | null): Promise<void> {
    if (file === null) return;
    const next = await file.text();
    guard(() => change(next));
  }

  return (
    <Card title={TEXTS.newStudy} aside={<span className={page.dim}>{TEXTS.format}</span>}>
      <div className={page.fields}>
        <div className={page.actions}>
          <Button size="sm" variant="default" onClick={() => guard(() => edit(EMPTY_STUDY))}>
            {TEXTS.createStudy}
          </Button>
          <Button size="sm" variant="default" onClick={() => guard(() => change(EXAMPLE))}>
            {TEXTS.startFromExample}
          </Button>
          <FileButton accept={FILES} onChange={(file) => void read(file)}>
            {(props) => (
              <Button {...props} size="sm" variant="default">
                {TEXTS.openFile}
              </Button>
            )}
          </FileButton>
        </div>
        {question}
        <DraftMark
          draft={draft}
          of={TEXTS.draftOf}
          words={TEXTS.draft}
          back={TEXTS.discardDraft}
          onDiscard={() => {
            draft.discard();
            begin.reset();
          }}
        />
        {document !== null && <StudyForm document={document} onChange={edit} />}
        {document === null && text.trim() !== "" && (
          <span className={page.dim}>{checked === null ? TEXTS.readingText : TEXTS.notReadable}</span>
        )}
        <Textarea
          aria-label={TEXTS.text}
          placeholder={TEXTS.textHint}
          value={text}
          onChange={(event) => change(event.currentTarget.value)}
          autosize
          minRows={14}
          maxRows={24}
          spellCheck={false}
          wrap="off"
          styles={{ input: { fontFamily: "var(--mantine-font-family-monospace)", fontSize: 12 } }}
        />
        <div className={page.decide}>
          <div className={page.actions}>
            <OperatorsOnly>
              <Button
                size="sm"
                disabled={text === ""}
                loading={begin.isPending}
                onClick={() =>
                  begin.mutate(text, {
                    onSuccess: (study) => {
                      draft.discard();
                      go(`/studies/${study.id}`);
                    },
                  })
                }
              >
                {TEXTS.compute}
              </Button>
            </OperatorsOnly>
          </div>
          <Refusal
            error={begin.error}
            about={text}
            text={checked?.problem || null}
            hint={
              checked?.points == null
                ? TEXTS.background
                : fillText(TEXTS.runsInBackground, {
                    runs: countThings(checked.points, TEXTS.runCount),
                    background: TEXTS.background,
                  })
            }
          />
        </div>
      </div>
    </Card>
  );
}
