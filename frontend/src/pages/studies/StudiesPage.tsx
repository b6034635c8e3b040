/** Page Studies: the list of all studies, or one study. */

import { useQuery } from "@tanstack/react-query";
import { useParams } from "wouter";
import { Card } from "../../components/Card";
import { studiesQuery } from "../../service/api/studies";
import page from "../Page.module.css";
import { NewStudy } from "./NewStudy";
import { StudyPage, StudyRows } from "./StudyPage";
import { TEXTS } from "./texts";

export default function StudiesPage() {
  const { id } = useParams();
  return id === undefined ? <AllStudies /> : <StudyPage key={id} id={Number(id)} />;
}

function AllStudies() {
  const studies = useQuery(studiesQuery);
  return (
    <div className={page.page}>
      <h1 className={page.title}>{TEXTS.title}</h1>
      <Card title={TEXTS.allStudies} aside={<span className={page.dim}>{TEXTS.allStudiesHint}</span>}>
        {studies.data === undefined && (
          <p className={page.empty}>{studies.error?.message ?? TEXTS.loading}</p>
        )}
        {studies.data?.length === 0 && <p className={page.empty}>{TEXTS.noStudies}</p>}
        {studies.data !== undefined && studies.data.length > 0 && <StudyRows studies={studies.data} />}
      </Card>
      <NewStudy />
    </div>
  );
}
