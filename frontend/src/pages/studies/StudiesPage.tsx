/** Studies: many simulated runs, computed beside the loop; all of them, or one. */

import { useQuery } from "@tanstack/react-query";
import { useParams } from "wouter";
import { Card } from "../../components/Card";
import { studiesQuery } from "../../service/api/studies";
import page from "../Page.module.css";
import { NewStudy } from "./NewStudy";
import { StudyPage, StudyRows } from "./StudyPage";

export default function StudiesPage() {
  const { id } = useParams();
  return id === undefined ? <AllStudies /> : <StudyPage key={id} id={Number(id)} />;
}

function AllStudies() {
  const studies = useQuery(studiesQuery);
  return (
    <div className={page.page}>
      <h1 className={page.title}>Studies</h1>
      <Card title="All studies" aside={<span className={page.dim}>many simulated runs each</span>}>
        {studies.data === undefined && <p className={page.empty}>{studies.error?.message ?? "Loading …"}</p>}
        {studies.data?.length === 0 && <p className={page.empty}>No study yet. Write one below.</p>}
        {studies.data !== undefined && studies.data.length > 0 && <StudyRows studies={studies.data} />}
      </Card>
      <NewStudy />
    </div>
  );
}
